//! Total variation of the images of a stack: differences, their adjoint, the proximal map, and the
//! ADMM update. Arrays of images have the shape `(N, H, W)`, those of differences `(N, 2, H, W)`.

use jotlight::tv::{self, Norm};
use jotlight::values::Values;
use ndarray::Axis;
use numpy::{PyReadonlyArray3, PyReadonlyArray4, PyReadwriteArray3, PyReadwriteArray4};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arguments::{PyAdmmStep, PyValues, check_length};
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
    let (images, mut out) = (images.as_array(), out.as_array_mut());
    check_length("differences", images.dim().0, out.dim().0)?;
    run(py, threads, || {
        images
            .axis_iter(Axis(0))
            .into_par_iter()
            .zip(out.axis_iter_mut(Axis(0)))
            .try_for_each(|(image, out)| tv::differences(image, out))
    })
}

/// Write Dᵀ `differences` into `out`, where D maps an image to its differences.
#[pyfunction]
pub fn differences_adjoint(
    py: Python<'_>,
    differences: PyReadonlyArray4<'_, f64>,
    mut out: PyReadwriteArray3<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (differences, mut out) = (differences.as_array(), out.as_array_mut());
    check_length("differences", out.dim().0, differences.dim().0)?;
    run(py, threads, || {
        differences
            .axis_iter(Axis(0))
            .into_par_iter()
            .zip(out.axis_iter_mut(Axis(0)))
            .try_for_each(|(differences, out)| tv::adjoint(differences, out))
    })
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
    let mut differences = differences.as_array_mut();
    let (images, _, height, width) = differences.dim();
    let thresholds = split(threshold.to_engine()?, images, height * width)?;
    run(py, threads, || {
        differences
            .axis_iter_mut(Axis(0))
            .into_par_iter()
            .zip(thresholds)
            .try_for_each(|(differences, threshold)| {
                tv::shrink(differences, threshold, norm(isotropic))
            })
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
    let differences = differences.as_array();
    let (images, _, height, width) = differences.dim();
    let weights = split(weight.to_engine()?, images, height * width)?;
    run(py, threads, || {
        differences
            .axis_iter(Axis(0))
            .into_par_iter()
            .zip(weights)
            .map(|(differences, weight)| tv::total_variation(differences, weight, norm(isotropic)))
            .collect()
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
    let (images, mut x, mut dual) = (images.as_array(), x.as_array_mut(), dual.as_array_mut());
    let (number, height, width) = images.dim();
    let steps = step.to_engine(number)?;
    let weights = split(weight.to_engine()?, number, height * width)?;
    check_length("x", number, x.dim().0)?;
    check_length("dual", number, dual.dim().0)?;
    run(py, threads, || {
        images
            .axis_iter(Axis(0))
            .into_par_iter()
            .zip(x.axis_iter_mut(Axis(0)))
            .zip(dual.axis_iter_mut(Axis(0)))
            .zip(steps)
            .zip(weights)
            .map(|((((image, x), dual), step), weight)| {
                tv::admm_update(&step, weight, norm(isotropic), image, x, dual)
            })
            .collect()
    })
}

/// Return the values of each image: one value for all pixels, or one value per pixel.
fn split(values: Values<'_, f64>, images: usize, pixels: usize) -> PyResult<Vec<Values<'_, f64>>> {
    if let Values::Each(values) = values {
        check_length("weights", images * pixels, values.len())?;
    }
    let part = |image| values.part(image * pixels..(image + 1) * pixels);
    Ok((0..images).map(part).collect())
}
