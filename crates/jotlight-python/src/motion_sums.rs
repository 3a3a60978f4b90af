//! Sums of blocks of frames that follow a moving scene, and the curve of its motion.

use jotlight::error::Result;
use jotlight::motion::{
    self, Accepted, Curve, Limits, Logarithms, Object, Relative, Seen, TILE, Tested, Totals,
};
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use numpy::{PyReadwriteArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use crate::motion::{PyCounts, counts_of, for_counts};
use crate::{run, run_alone};

/// Add images of counts to `out`.
#[pyfunction]
pub fn add_counts(
    py: Python<'_>,
    parts: Vec<PyReadonlyArray2<'_, i32>>,
    mut out: PyReadwriteArray2<'_, i32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let parts: Vec<_> = parts.iter().map(|part| part.as_array()).collect();
    let out = out.as_array_mut();
    run(py, threads, || motion::add_counts(&parts, out))
}

/// Add the counts of the pixels that pass a test to sums, and write these pixels into `mask`.
#[pyfunction]
pub fn add_accepted(
    py: Python<'_>,
    test: PyReadonlyArray2<'_, f32>,
    limit: f32,
    ones: PyReadonlyArray2<'_, i32>,
    trials: PyReadonlyArray2<'_, i32>,
    mut total_ones: PyReadwriteArray2<'_, i32>,
    mut total_trials: PyReadwriteArray2<'_, i32>,
    mut mask: PyReadwriteArray2<'_, u8>,
    threads: Option<isize>,
) -> PyResult<()> {
    let test = test.as_array();
    let block = Accepted {
        counts: [ones.as_array(), trials.as_array()],
        sums: [total_ones.as_array_mut(), total_trials.as_array_mut()],
        mask: mask.as_array_mut(),
    };
    run(py, threads, || motion::add_accepted(test, limit, block))
}

/// A block of frames: the ones and trials of it and of its neighbors, its index among them, and its
/// mask.
type PyTested<'py> = (
    Vec<(PyReadonlyArray2<'py, i32>, PyReadonlyArray2<'py, i32>)>,
    usize,
    PyReadwriteArray2<'py, u8>,
);

/// Add the counts of blocks to sums where they and their neighbors agree with a template, and write these
/// pixels into their masks. Return for each block whether the light is the same, so that this was
/// done.
#[pyfunction]
pub fn accept_agreeing(
    py: Python<'_>,
    template: (PyReadonlyArray2<'_, f32>, PyReadonlyArray2<'_, i32>),
    limits: (f32, f64),
    mut blocks: Vec<PyTested<'_>>,
    mut accepted: (PyReadwriteArray2<'_, i32>, PyReadwriteArray2<'_, i32>),
    mut available: PyReadwriteArray2<'_, i32>,
    threads: Option<isize>,
) -> PyResult<Vec<bool>> {
    let (mut tested, mut masks) = (Vec::new(), Vec::new());
    for (near, own, mask) in &mut blocks {
        let counts = near.iter().map(|(ones, trials)| counts_of(ones, trials));
        tested.push(Tested {
            near: counts.collect(),
            own: *own,
        });
        masks.push(mask.as_array_mut());
    }
    let template = (template.0.as_array(), template.1.as_array());
    let limits = Limits {
        chi_squared: limits.0,
        change: limits.1,
    };
    let totals = Totals {
        accepted: [accepted.0.as_array_mut(), accepted.1.as_array_mut()],
        available: available.as_array_mut(),
        masks,
    };
    run(py, threads, || {
        motion::accept_agreeing(template, limits, &tested, totals)
    })
}

/// Return the ratio of the ones to the number that a template predicts, from 0.1 to 10.
#[pyfunction]
pub fn brightness(
    py: Python<'_>,
    ones: PyCounts<'_>,
    trials: PyCounts<'_>,
    probability: PyReadonlyArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<f64> {
    let probability = probability.as_array();
    for_counts!(ones, trials => {
        let (ones, trials) = (ones.as_array(), trials.as_array());
        run(py, threads, || motion::brightness_of(ones, trials, probability))
    })
}

/// Return the ratio of the brightness of two parts of the frames, from 0.1 to 10.
#[pyfunction]
pub fn relative_brightness(
    py: Python<'_>,
    ones: PyCounts<'_>,
    trials: PyCounts<'_>,
    other_ones: PyCounts<'_>,
    other_trials: PyCounts<'_>,
    threads: Option<isize>,
) -> PyResult<f64> {
    for_counts!(ones, trials, other_ones, other_trials => {
        let (first, second) = (
            counts_of(&ones, &trials),
            counts_of(&other_ones, &other_trials),
        );
        run(py, threads, || motion::relative_brightness(&first, &second))
    })
}

/// A segment: its label, what its template predicts, and how far its pixels are from others, at the
/// centers of tiles.
type PySeen<'py> = (u8, PyReadonlyArray3<'py, f32>, PyReadonlyArray3<'py, f32>);

/// A segment in front: its label, and how far its pixels are from others, at the centers of tiles.
type PyFront<'py> = (u8, PyReadonlyArray3<'py, f32>);

/// Add the gain of an object over other segments in a block to `out`, (3, H, W).
#[pyfunction]
pub fn add_object_gain(
    py: Python<'_>,
    label: u8,
    ones: PyCounts<'_>,
    trials: PyCounts<'_>,
    predicted: PyReadonlyArray3<'_, f32>,
    others: Vec<PySeen<'_>>,
    labels: PyReadonlyArray2<'_, u8>,
    mut out: PyReadwriteArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (labels, out) = (labels.as_array(), out.as_array_mut());
    let others: Vec<_> = others
        .iter()
        .map(|(label, predicted, nodes)| (*label, predicted.as_array(), nodes.as_array()))
        .collect();
    for_counts!(ones, trials => {
        let object = Object {
            label,
            counts: counts_of(&ones, &trials),
            predicted: predicted.as_array(),
        };
        run(py, threads, || {
            let seen = |&(label, predicted, nodes)| {
                let relative = Relative::new(nodes, TILE, labels.dim())?;
                Ok(Seen { label, predicted, relative })
            };
            let others: Vec<_> = others.iter().map(seen).collect::<Result<_>>()?;
            motion::add_object_gain(&object, &others, labels, out)
        })
    })
}

/// Set `out` to True where pixels are behind segments in front.
#[pyfunction]
pub fn mark_covered(
    py: Python<'_>,
    fronts: Vec<PyFront<'_>>,
    labels: PyReadonlyArray2<'_, u8>,
    mut out: PyReadwriteArray2<'_, bool>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (labels, out) = (labels.as_array(), out.as_array_mut());
    let fronts: Vec<_> = fronts
        .iter()
        .map(|(label, nodes)| (*label, nodes.as_array()))
        .collect();
    run(py, threads, || {
        let front = |&(label, nodes)| Ok((label, Relative::new(nodes, TILE, labels.dim())?));
        let fronts: Vec<_> = fronts.iter().map(front).collect::<Result<_>>()?;
        motion::mark_covered(&fronts, labels, out)
    })
}

/// Set `out` to the pixels whose gain minus the cost of their outline is largest.
#[pyfunction]
pub fn shortest_outlines(
    py: Python<'_>,
    gain: PyReadonlyArray2<'_, f32>,
    length: f32,
    mut out: PyReadwriteArray2<'_, bool>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (gain, out) = (gain.as_array(), out.as_array_mut());
    run(py, threads, || motion::shortest_outlines(gain, length, out))
}

/// Return the most probable curve of a motion, (n, 6).
#[pyfunction]
pub fn smooth_curve<'py>(
    py: Python<'py>,
    estimates: PyReadonlyArray2<'_, f64>,
    information: PyReadonlyArray3<'_, f64>,
    ratios: PyReadonlyArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (estimates, information) = (estimates.as_array(), information.as_array());
    let ratios = ratios.as_slice()?;
    let curve = run(py, threads, || {
        Curve::new(estimates, information, ratios)?.smooth()
    })?;
    Ok(curve.into_pyarray(py))
}

/// Return -2 times the logarithm of the probability of estimates under weights, without a constant,
/// and the most probable curve, (n, 6).
#[pyfunction]
pub fn cost_of_curve<'py>(
    py: Python<'py>,
    estimates: PyReadonlyArray2<'_, f64>,
    information: PyReadonlyArray3<'_, f64>,
    ratios: PyReadonlyArray1<'_, f64>,
    weights: Logarithms,
) -> PyResult<(f64, Bound<'py, PyArray2<f64>>)> {
    let (estimates, information) = (estimates.as_array(), information.as_array());
    let ratios = ratios.as_slice()?;
    let (cost, curve) = run_alone(py, || {
        Curve::new(estimates, information, ratios)?.cost(&weights)
    })?;
    Ok((cost, curve.into_pyarray(py)))
}
