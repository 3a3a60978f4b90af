//! Total variation of the images of a stack: differences, their adjoint, the proximal map, and the
//! ADMM update. Arrays of images have the shape `(N, H, W)`, those of differences `(N, 2, H, W)`.

use jotlight::tv::{self, Norm};
use numpy::{PyReadonlyArray3, PyReadonlyArray4, PyReadwriteArray3, PyReadwriteArray4};
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
pub fn differences(
    py: Python<'_>,
    images: PyReadonlyArray3<'_, f64>,
    mut out: PyReadwriteArray4<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (images, out) = (images.as_array(), out.as_array_mut());
    run(py, threads, || tv::differences(images, out))
}

/// Write Dᵀ `differences` into `out`, where D maps an image to its differences.
#[pyfunction]
pub fn differences_adjoint(
    py: Python<'_>,
    differences: PyReadonlyArray4<'_, f64>,
    mut out: PyReadwriteArray3<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (differences, out) = (differences.as_array(), out.as_array_mut());
    run(py, threads, || tv::adjoint(differences, out))
}

/// Replace `differences` with the minimizer v of Σ threshold · |v| + ½ ‖v − differences‖².
#[pyfunction]
pub fn shrink(
    py: Python<'_>,
    mut differences: PyReadwriteArray4<'_, f64>,
    threshold: PyValues<'_, f64>,
    isotropic: bool,
    threads: Option<isize>,
) -> PyResult<()> {
    let (differences, threshold) = (differences.as_array_mut(), threshold.to_engine()?);
    run(py, threads, || {
        tv::shrink(differences, threshold, norm(isotropic))
    })
}

/// Return Σ weight · |differences| of each image.
#[pyfunction]
pub fn total_variation(
    py: Python<'_>,
    differences: PyReadonlyArray4<'_, f64>,
    weight: PyValues<'_, f64>,
    isotropic: bool,
    threads: Option<isize>,
) -> PyResult<Vec<f64>> {
    let (differences, weight) = (differences.as_array(), weight.to_engine()?);
    run(py, threads, || {
        tv::total_variation(differences, weight, norm(isotropic))
    })
}

/// Update `x` and `dual` of each image by one ADMM iteration with its own penalty, and return
/// ‖D image − x‖² of each.
#[pyfunction]
pub fn total_variation_admm_update(
    py: Python<'_>,
    step: PyAdmmStep<'_>,
    weight: PyValues<'_, f64>,
    isotropic: bool,
    images: PyReadonlyArray3<'_, f64>,
    mut x: PyReadwriteArray4<'_, f64>,
    mut dual: PyReadwriteArray4<'_, f64>,
    threads: Option<isize>,
) -> PyResult<Vec<f64>> {
    let (images, x, dual) = (images.as_array(), x.as_array_mut(), dual.as_array_mut());
    let (steps, weight) = (step.to_engine()?, weight.to_engine()?);
    run(py, threads, || {
        tv::admm_update(&steps, weight, norm(isotropic), images, x, dual)
    })
}
