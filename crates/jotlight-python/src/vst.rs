//! The variance-stabilizing transform of binomial counts, and its inverses.

use jotlight::vst::{ExactInverse, algebraic_inverse, map, map_with_trials, transform};
use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::arguments::PyValues;
use crate::run;

/// Write the Anscombe transform of the number of ones among `trials` readings into `out`.
#[pyfunction]
pub fn anscombe(
    py: Python<'_>,
    counts: PyReadonlyArray1<'_, f32>,
    trials: PyValues<'_, f64>,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (counts, trials, out) = (counts.as_array(), trials.to_engine()?, out.as_array_mut());
    run(py, threads, || {
        map_with_trials(counts, trials, out, transform)
    })
}

/// Write the algebraic inverse of the Anscombe transform into `out`.
#[pyfunction]
pub fn inverse_anscombe_algebraic(
    py: Python<'_>,
    z: PyReadonlyArray1<'_, f32>,
    trials: PyValues<'_, f64>,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (z, trials, out) = (z.as_array(), trials.to_engine()?, out.as_array_mut());
    run(py, threads, || {
        map_with_trials(z, trials, out, algebraic_inverse)
    })
}

/// Write the exact unbiased inverse of the Anscombe transform into `out`.
#[pyfunction]
pub fn inverse_anscombe_exact(
    py: Python<'_>,
    z: PyReadonlyArray1<'_, f32>,
    trials: u32,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (z, out) = (z.as_array(), out.as_array_mut());
    run(py, threads, || {
        let exact = ExactInverse::new(trials)?;
        map(z, out, |z| exact.inverse(z))
    })
}
