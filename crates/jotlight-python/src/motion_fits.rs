//! Fits of motions to the displacement errors of tiles.

use jotlight::motion::{self, AffineFit, EquationsView, Share, Smoothness, Start, Sums};
use ndarray::{Array3, Array4, Axis};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyArray4};
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use crate::motion::{FilteredTemplate, PyCounts, mixed_counts};
use crate::{run, run_alone, to_python};

/// The errors of all tiles, and the information about the coefficients.
type PyAffineFit<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<f64>>);

/// Return the affine displacement errors of a segment, and the information about its coefficients.
#[pyfunction]
pub fn fit_affine<'py>(
    py: Python<'py>,
    information: PyReadonlyArray3<'_, f64>,
    right: PyReadonlyArray3<'_, f64>,
    weights: PyReadonlyArray2<'_, f64>,
    basis: PyReadonlyArray2<'_, f64>,
) -> PyResult<PyAffineFit<'py>> {
    let equations = EquationsView {
        information: information.as_array(),
        right: right.as_array(),
    };
    let (weights, basis) = (weights.as_array(), basis.as_array());
    // This takes less time than to wake another thread.
    let fit = py.detach(|| motion::fit_affine(equations, weights, basis));
    let AffineFit {
        errors,
        information,
    } = fit.map_err(to_python)?;
    Ok((errors.into_pyarray(py), information.into_pyarray(py)))
}

/// Return the smooth field of displacements that fits the equations.
///
/// `smoothness` is the tuple (λ1, λ2, ρ).
#[pyfunction]
pub fn solve_field<'py>(
    py: Python<'py>,
    information: PyReadonlyArray3<'_, f64>,
    right: PyReadonlyArray3<'_, f64>,
    now: PyReadonlyArray3<'_, f64>,
    predicted: PyReadonlyArray3<'_, f64>,
    basis: PyReadonlyArray2<'_, f64>,
    smoothness: (f64, f64, f64),
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let equations = EquationsView {
        information: information.as_array(),
        right: right.as_array(),
    };
    let start = Start {
        now: now.as_array(),
        predicted: predicted.as_array(),
    };
    let basis = basis.as_array();
    let (to_prediction, to_affine, outline) = smoothness;
    let smoothness = Smoothness {
        to_prediction,
        to_affine,
        outline,
    };
    let field = run_alone(py, || {
        motion::solve_field(equations, start, basis, smoothness)
    })?;
    Ok(field.into_pyarray(py))
}

/// Sums of a block: ones, trials, remainders, and the number of frames.
type PySums<'py> = (
    PyCounts<'py>,
    PyCounts<'py>,
    PyReadonlyArray3<'py, f32>,
    usize,
);

/// Return views of the sums of blocks if all counts are of a kind, or None.
macro_rules! sums_of {
    ($kind:ident, $blocks:expr) => {
        $blocks
            .iter()
            .map(|(ones, trials, remainders, frames)| match (ones, trials) {
                (PyCounts::$kind(ones), PyCounts::$kind(trials)) => Some(Sums {
                    ones: ones.as_array(),
                    trials: trials.as_array(),
                    remainders: remainders.as_array(),
                    frames: *frames,
                }),
                _ => None,
            })
            .collect::<Option<Vec<_>>>()
    };
}

/// The errors of all tiles of each block, (n, 2, rows, columns), and the information (n, 6, 6).
type PyFits<'py> = (Bound<'py, PyArray4<f64>>, Bound<'py, PyArray3<f64>>);

/// Return the affine displacement errors of blocks that are part of a template, and the information
/// about their coefficients.
#[pyfunction]
pub fn fit_blocks<'py>(
    py: Python<'py>,
    template: Py<FilteredTemplate>,
    share: (f64, f64),
    blocks: Vec<PySums<'py>>,
    weights: PyReadonlyArray2<'_, f64>,
    basis: PyReadonlyArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<PyFits<'py>> {
    let template = &template.get().0;
    let share = Share {
        mean_trials: share.0,
        min_others: share.1,
    };
    let (weights, basis) = (weights.as_array(), basis.as_array());
    let fits = if let Some(blocks) = sums_of!(Whole, blocks) {
        run(py, threads, || {
            motion::fit_blocks(template, share, &blocks, weights, basis)
        })
    } else if let Some(blocks) = sums_of!(Real, blocks) {
        run(py, threads, || {
            motion::fit_blocks(template, share, &blocks, weights, basis)
        })
    } else {
        Err(mixed_counts())
    }?;
    let (rows, columns) = weights.dim();
    let mut errors = Array4::zeros((fits.len(), 2, rows, columns));
    let mut information = Array3::zeros((fits.len(), 6, 6));
    for (index, fit) in fits.iter().enumerate() {
        errors.index_axis_mut(Axis(0), index).assign(&fit.errors);
        let mut entries = information.index_axis_mut(Axis(0), index);
        entries.assign(&fit.information);
    }
    Ok((errors.into_pyarray(py), information.into_pyarray(py)))
}
