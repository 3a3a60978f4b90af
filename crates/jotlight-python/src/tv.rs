//! Total variation: differences, their adjoint, the proximal map, and the ADMM update.

use jotlight::tv::{self, Norm};
use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use crate::arguments::{PyAdmmStep, PyValues};
use crate::run;

fn norm(isotropic: bool) -> Norm {
    if isotropic {
        Norm::Isotropic
    } else {
        Norm::Anisotropic
    }
}

/// Write the differences to the pixels below and on the right into `out`.
#[pyfunction]
#[pyo3(signature = (image, out, threads))]
pub fn differences(
    py: Python<'_>,
    image: PyReadonlyArray2<'_, f64>,
    mut out: PyReadwriteArray3<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (image, out) = (image.as_array(), out.as_array_mut());
    run(py, threads, || tv::differences(image, out))
}

/// Write Dᵀ `differences` into `out`, where D maps an image to its differences.
#[pyfunction]
#[pyo3(signature = (differences, out, threads))]
pub fn differences_adjoint(
    py: Python<'_>,
    differences: PyReadonlyArray3<'_, f64>,
    mut out: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (differences, out) = (differences.as_array(), out.as_array_mut());
    run(py, threads, || tv::adjoint(differences, out))
}

/// Replace `differences` with the minimizer v of Σ threshold · |v| + ½ ‖v − differences‖².
#[pyfunction]
#[pyo3(signature = (differences, threshold, isotropic, threads))]
pub fn shrink(
    py: Python<'_>,
    mut differences: PyReadwriteArray3<'_, f64>,
    threshold: PyValues<'_, f64>,
    isotropic: bool,
    threads: Option<isize>,
) -> PyResult<()> {
    let (differences, threshold) = (differences.as_array_mut(), threshold.to_engine()?);
    run(py, threads, || {
        tv::shrink(differences, threshold, norm(isotropic))
    })
}

/// Return Σ weight · |differences|.
#[pyfunction]
#[pyo3(signature = (differences, weight, isotropic, threads))]
pub fn total_variation(
    py: Python<'_>,
    differences: PyReadonlyArray3<'_, f64>,
    weight: PyValues<'_, f64>,
    isotropic: bool,
    threads: Option<isize>,
) -> PyResult<f64> {
    let (differences, weight) = (differences.as_array(), weight.to_engine()?);
    run(py, threads, || {
        tv::total_variation(differences, weight, norm(isotropic))
    })
}

/// Update `x` and `dual` by one ADMM iteration, and return ‖D image − x‖².
#[pyfunction]
#[pyo3(signature = (step, weight, isotropic, image, x, dual, threads))]
#[allow(clippy::too_many_arguments)]
pub fn total_variation_admm_update(
    py: Python<'_>,
    step: PyAdmmStep,
    weight: PyValues<'_, f64>,
    isotropic: bool,
    image: PyReadonlyArray2<'_, f64>,
    mut x: PyReadwriteArray3<'_, f64>,
    mut dual: PyReadwriteArray3<'_, f64>,
    threads: Option<isize>,
) -> PyResult<f64> {
    let (step, weight) = (step.to_engine(), weight.to_engine()?);
    let (image, x, dual) = (image.as_array(), x.as_array_mut(), dual.as_array_mut());
    run(py, threads, || {
        tv::admm_update(&step, weight, norm(isotropic), image, x, dual)
    })
}
