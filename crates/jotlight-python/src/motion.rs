//! Counts of bits that follow a moving scene.

use jotlight::bits::PackedBits;
use jotlight::motion::{
    self, Comparison, Counts, Displacements, Equations, ShiftedCounts, Sums, Template, Windows,
};
use numpy::{Element, IntoPyArray, PyArray3};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArray4};
use numpy::{PyReadwriteArray2, PyReadwriteArray3};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::{run, to_python};

/// Counts of pixels: whole numbers of bits, or the real numbers of an equivalent sensor.
#[derive(FromPyObject)]
pub enum PyCounts<'py> {
    Whole(PyReadonlyArray2<'py, i32>),
    Real(PyReadonlyArray2<'py, f32>),
}

/// Evaluate an expression with pairs of counts that are all whole, or all real numbers.
macro_rules! for_counts {
    ($($counts:ident),+ => $expression:expr) => {
        match ($($counts,)+) {
            ($(PyCounts::Whole($counts),)+) => $expression,
            ($(PyCounts::Real($counts),)+) => $expression,
            _ => Err($crate::motion::mixed_counts()),
        }
    };
}

pub(crate) use for_counts;

pub(crate) fn mixed_counts() -> PyErr {
    PyTypeError::new_err("counts: expected arrays that are all int32 or all float32")
}

/// Return the ones and the trials of pixels.
pub fn counts_of<'a, C: Element>(
    ones: &'a PyReadonlyArray2<'_, C>,
    trials: &'a PyReadonlyArray2<'_, C>,
) -> Counts<'a, C> {
    Counts {
        ones: ones.as_array(),
        trials: trials.as_array(),
    }
}

/// Add values of the jots along a motion to `out`. The motion is that of [`count_shifted`].
#[pyfunction]
pub fn add_shifted_values(
    py: Python<'_>,
    values: PyReadonlyArray3<'_, f32>,
    fields: PyReadonlyArray4<'_, f32>,
    tile: Option<usize>,
    times: PyReadonlyArray1<'_, f64>,
    mut out: PyReadwriteArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (values, fields, times) = (values.as_array(), fields.as_array(), times.as_slice()?);
    let out = out.as_array_mut();
    run(py, threads, || {
        let (_, rows, columns) = values.dim();
        let motion = Displacements::new(fields, tile, rows, columns)?;
        motion::add_shifted_values(values, &motion, times, out)
    })
}

/// Count the ones of frames whose pixels are displaced, and write the sums into `ones` and the others.
///
/// `tile` is the width of the tiles of the fields, or None for a displacement of each pixel. At time
/// n, a frame has the displacements of field n.
#[pyfunction]
pub fn count_shifted(
    py: Python<'_>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    fields: PyReadonlyArray4<'_, f32>,
    tile: Option<usize>,
    times: PyReadonlyArray1<'_, f64>,
    valid: Option<PyReadonlyArray2<'_, u8>>,
    mut ones: PyReadwriteArray2<'_, i32>,
    mut trials: PyReadwriteArray2<'_, i32>,
    mut remainders: PyReadwriteArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (packed, fields) = (packed.as_array(), fields.as_array());
    let (times, valid) = (
        times.as_slice()?,
        valid.as_ref().map(|valid| valid.as_array()),
    );
    let sums = ShiftedCounts {
        ones: ones.as_array_mut(),
        trials: trials.as_array_mut(),
        remainders: remainders.as_array_mut(),
    };
    run(py, threads, || {
        let rows = packed.dim().1;
        motion::count_shifted(
            &PackedBits::new(packed, width)?,
            &Displacements::new(fields, tile, rows, width)?,
            times,
            valid,
            sums,
        )
    })
}

/// The template of a motion after a Gaussian filter. Its derivatives are computed only once.
#[pyclass(frozen, name = "FilteredTemplate")]
pub struct FilteredTemplate(pub(crate) Template);

#[pymethods]
impl FilteredTemplate {
    #[new]
    fn new(
        py: Python<'_>,
        probability: PyReadonlyArray2<'_, f32>,
        trials: PyReadonlyArray2<'_, i32>,
        sigma: f64,
        threads: Option<isize>,
    ) -> PyResult<Self> {
        let (probability, trials) = (probability.as_array(), trials.as_array());
        run(py, threads, || Template::new(probability, trials, sigma)).map(Self)
    }
}

/// A and b of all tiles.
type PyEquations<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray3<f64>>);

/// Return the normal equations of the displacement errors of all tiles.
#[pyfunction]
pub fn displacement_equations<'py>(
    py: Python<'py>,
    template: Py<FilteredTemplate>,
    ones: PyCounts<'_>,
    trials: PyCounts<'_>,
    remainders: PyReadonlyArray3<'_, f32>,
    frames: usize,
    threads: Option<isize>,
) -> PyResult<PyEquations<'py>> {
    let template = &template.get().0;
    let Equations { information, right } = for_counts!(ones, trials => {
        let sums = Sums {
            ones: ones.as_array(),
            trials: trials.as_array(),
            remainders: remainders.as_array(),
            frames,
        };
        run(py, threads, || motion::normal_equations(template, sums))
    })?;
    Ok((information.into_pyarray(py), right.into_pyarray(py)))
}

/// Return the remainders of the same counts along a changed motion.
#[pyfunction]
pub fn changed_remainders<'py>(
    py: Python<'py>,
    remainders: PyReadonlyArray3<'_, f32>,
    change: PyReadonlyArray3<'_, f64>,
    frames: usize,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (remainders, change) = (remainders.as_array(), change.as_array());
    // This takes less time than to wake another thread.
    let changed = py.detach(|| motion::changed_remainders(remainders, change, frames));
    Ok(changed.map_err(to_python)?.into_pyarray(py))
}

/// Write probabilities into `out` after their pixels are moved by the mean remainders, from `least` to
/// 1 - `least`.
#[pyfunction]
pub fn undo_remainders(
    py: Python<'_>,
    image: PyReadonlyArray2<'_, f32>,
    remainders: PyReadonlyArray3<'_, f32>,
    frames: usize,
    least: f64,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (image, remainders) = (image.as_array(), remainders.as_array());
    let out = out.as_array_mut();
    run(py, threads, || {
        motion::undo_remainders(image, remainders, frames, least, out)
    })
}

/// Write χ² of each pixel into `out`.
#[pyfunction]
pub fn chi_squared(
    py: Python<'_>,
    ones: PyCounts<'_>,
    trials: PyCounts<'_>,
    probability: PyReadonlyArray2<'_, f32>,
    trials_of_template: PyReadonlyArray2<'_, i32>,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let out = out.as_array_mut();
    for_counts!(ones, trials => {
        let parts = [counts_of(&ones, &trials)];
        let comparison = Comparison {
            parts: &parts,
            probability: probability.as_array(),
            trials_of_template: trials_of_template.as_array(),
        };
        run(py, threads, || motion::chi_squared(&comparison, out))
    })
}

/// Write how much two parts of the frames disagree in each square of pixels into `out`.
#[pyfunction]
pub fn disagreement(
    py: Python<'_>,
    ones: PyCounts<'_>,
    trials: PyCounts<'_>,
    other_ones: PyCounts<'_>,
    other_trials: PyCounts<'_>,
    mut out: PyReadwriteArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let out = out.as_array_mut();
    for_counts!(ones, trials, other_ones, other_trials => {
        let (first, second) = (
            counts_of(&ones, &trials),
            counts_of(&other_ones, &other_trials),
        );
        run(py, threads, || motion::disagreement(&first, &second, out))
    })
}

/// Return the scores of displacements per block in each window.
///
/// `filters` are the widths of the filters between which details are correlated, in pixels.
#[pyfunction]
pub fn velocity_scores<'py>(
    py: Python<'py>,
    blocks: PyReadonlyArray3<'_, i32>,
    corners: Vec<(usize, usize)>,
    size: (usize, usize),
    filters: (f64, f64),
    lags: Vec<usize>,
    line: PyReadonlyArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (blocks, line) = (blocks.as_array(), line.as_slice()?);
    let windows = Windows {
        corners: &corners,
        size,
        filters,
    };
    let scores = run(py, threads, || {
        motion::velocity_scores(blocks, windows, &lags, line)
    })?;
    Ok(scores.into_pyarray(py))
}

/// Return the largest sums of shifted scores, each with its row and its column.
#[pyfunction]
pub fn peak_of_shifted_scores(
    py: Python<'_>,
    scores: PyReadonlyArray3<'_, f32>,
    shifts: PyReadonlyArray3<'_, i64>,
    threads: Option<isize>,
) -> PyResult<Vec<(f32, (usize, usize))>> {
    let (scores, shifts) = (scores.as_array(), shifts.as_array());
    let peaks = run(py, threads, || {
        motion::peak_of_shifted_scores(scores, shifts)
    })?;
    Ok(peaks.iter().map(|peak| (peak.score, peak.place)).collect())
}
