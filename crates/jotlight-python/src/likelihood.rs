//! The log-likelihood of counted bits and its derivatives, and the detection probability.

use jotlight::likelihood::{Readings, Threshold};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1, PyReadwriteArray2};
use pyo3::prelude::*;

use crate::arguments::{PyAdmmStep, PyValues, check_length};
use crate::{run, to_python};

/// The readings of a sensor, as the tuple (threshold, ones, trials, efficiency, dark counts).
#[derive(FromPyObject)]
pub struct PyReadings<'py>(
    u32,
    PyReadonlyArray1<'py, i32>,
    PyValues<'py, f64>,
    PyValues<'py, f64>,
    PyValues<'py, f64>,
);

impl PyReadings<'_> {
    pub fn to_engine(&self) -> PyResult<Readings<'_>> {
        let Self(threshold, ones, trials, efficiency, dark_counts) = self;
        Readings::new(
            Threshold::new(*threshold).map_err(to_python)?,
            ones.as_slice()?,
            trials.to_engine()?,
            efficiency.to_engine()?,
            dark_counts.to_engine()?,
        )
        .map_err(to_python)
    }
}

/// Return ℓ of each image, where `light` `(N, cells)` is the light of each element.
#[pyfunction]
pub fn log_likelihood(
    py: Python<'_>,
    readings: PyReadings<'_>,
    light: PyReadonlyArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<Vec<f64>> {
    let readings = readings.to_engine()?;
    let (images, light) = (light.as_array().dim().0, light.as_slice()?);
    run(py, threads, || readings.values(images, light))
}

/// Write ∂ℓ/∂s of each element into `gradient`, and −∂²ℓ/∂s² into `curvature`.
#[pyfunction]
pub fn likelihood_gradient_and_curvature(
    py: Python<'_>,
    readings: PyReadings<'_>,
    light: PyReadonlyArray1<'_, f64>,
    mut gradient: PyReadwriteArray1<'_, f64>,
    mut curvature: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (readings, light) = (readings.to_engine()?, light.as_slice()?);
    let (gradient, curvature) = (gradient.as_slice_mut()?, curvature.as_slice_mut()?);
    run(py, threads, || {
        readings.gradient_and_curvature(light, gradient, curvature)
    })
}

/// Write the Fisher information of each element about its light into `information`.
#[pyfunction]
pub fn likelihood_information(
    py: Python<'_>,
    readings: PyReadings<'_>,
    light: PyReadonlyArray1<'_, f64>,
    mut information: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (readings, light) = (readings.to_engine()?, light.as_slice()?);
    let information = information.as_slice_mut()?;
    run(py, threads, || readings.information(light, information))
}

/// Replace `point` with the minimizer in [0, `max_light`] of −ℓ(x) + ½ `penalty` (x − point)².
#[pyfunction]
pub fn likelihood_proximal(
    py: Python<'_>,
    readings: PyReadings<'_>,
    penalty: f64,
    max_light: f64,
    guess: PyReadonlyArray1<'_, f64>,
    mut point: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let readings = readings.to_engine()?;
    let (guess, point) = (guess.as_slice()?, point.as_slice_mut()?);
    run(py, threads, || {
        readings.proximal(penalty, max_light, guess, point)
    })
}

/// Update `x` and `dual` of each image by one ADMM iteration with its own penalty, and return
/// ‖light − x‖² of each. The arrays have the shape `(N, cells)`.
#[pyfunction]
pub fn likelihood_admm_update(
    py: Python<'_>,
    readings: PyReadings<'_>,
    step: PyAdmmStep<'_>,
    max_light: f64,
    light: PyReadonlyArray2<'_, f64>,
    mut x: PyReadwriteArray2<'_, f64>,
    mut dual: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<Vec<f64>> {
    let (readings, steps) = (readings.to_engine()?, step.to_engine()?);
    check_length("penalties", light.as_array().dim().0, steps.len())?;
    let (light, x, dual) = (light.as_slice()?, x.as_slice_mut()?, dual.as_slice_mut()?);
    run(py, threads, || {
        readings.admm_update(&steps, max_light, light, x, dual)
    })
}

/// Return P(b = 1) = P(q, rate) for the threshold q.
#[pyfunction]
pub fn detection_probability(threshold: u32, rate: f64) -> PyResult<f64> {
    let threshold = Threshold::new(threshold).map_err(to_python)?;
    Ok(threshold.detection_probability(rate))
}

/// Return the rate at which the detection probability equals `probability`.
#[pyfunction]
pub fn inverse_detection_probability(threshold: u32, probability: f64) -> PyResult<f64> {
    let threshold = Threshold::new(threshold).map_err(to_python)?;
    Ok(threshold.inverse_detection_probability(probability))
}
