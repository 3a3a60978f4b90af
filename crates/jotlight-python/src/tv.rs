use jotlight::tv::{self, Norm};
use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use crate::likelihood::{PyFloats, PyStep, step_of};
use crate::run;

fn norm(isotropic: bool) -> Norm {
    if isotropic {
        Norm::Isotropic
    } else {
        Norm::Anisotropic
    }
}

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

#[pyfunction]
#[pyo3(signature = (planes, out, threads))]
pub fn differences_adjoint(
    py: Python<'_>,
    planes: PyReadonlyArray3<'_, f64>,
    mut out: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (planes, out) = (planes.as_array(), out.as_array_mut());
    run(py, threads, || tv::adjoint(planes, out))
}

#[pyfunction]
#[pyo3(signature = (planes, threshold, isotropic, threads))]
pub fn shrink(
    py: Python<'_>,
    mut planes: PyReadwriteArray3<'_, f64>,
    threshold: PyFloats<'_>,
    isotropic: bool,
    threads: Option<isize>,
) -> PyResult<()> {
    let (planes, threshold) = (planes.as_array_mut(), threshold.view()?);
    run(py, threads, || {
        tv::shrink(planes, threshold, norm(isotropic))
    })
}

#[pyfunction]
#[pyo3(signature = (planes, weight, isotropic, threads))]
pub fn total_variation(
    py: Python<'_>,
    planes: PyReadonlyArray3<'_, f64>,
    weight: PyFloats<'_>,
    isotropic: bool,
    threads: Option<isize>,
) -> PyResult<f64> {
    let (planes, weight) = (planes.as_array(), weight.view()?);
    run(py, threads, || tv::total(planes, weight, norm(isotropic)))
}

#[pyfunction]
#[pyo3(signature = (step, weight, isotropic, image, x, dual, threads))]
#[allow(clippy::too_many_arguments)]
pub fn total_variation_admm_update(
    py: Python<'_>,
    step: PyStep,
    weight: PyFloats<'_>,
    isotropic: bool,
    image: PyReadonlyArray2<'_, f64>,
    mut x: PyReadwriteArray3<'_, f64>,
    mut dual: PyReadwriteArray3<'_, f64>,
    threads: Option<isize>,
) -> PyResult<f64> {
    let (image, x, dual) = (image.as_array(), x.as_array_mut(), dual.as_array_mut());
    let weight = weight.view()?;
    run(py, threads, || {
        tv::split(&step_of(step), weight, norm(isotropic), image, x, dual)
    })
}
