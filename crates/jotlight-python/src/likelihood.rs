use jotlight::likelihood::{Seen, Step, Threshold, Values};
use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::{run, to_python};

/// One whole number for all cells, or one for each.
#[derive(FromPyObject)]
pub enum PyCounts<'py> {
    Same(i32),
    Each(PyReadonlyArray1<'py, i32>),
}

impl PyCounts<'_> {
    pub fn view(&self) -> PyResult<Values<'_, i32>> {
        Ok(match self {
            Self::Same(value) => Values::Same(*value),
            Self::Each(values) => Values::Each(values.as_slice()?),
        })
    }
}

/// One number for all cells, or one for each.
#[derive(FromPyObject)]
pub enum PyFloats<'py> {
    Same(f64),
    Each(PyReadonlyArray1<'py, f64>),
}

impl PyFloats<'_> {
    pub fn view(&self) -> PyResult<Values<'_, f64>> {
        Ok(match self {
            Self::Same(value) => Values::Same(*value),
            Self::Each(values) => Values::Each(values.as_slice()?),
        })
    }
}

/// (threshold, ones, trials, efficiency, dark counts), as `Likelihood._seen` gives them.
#[derive(FromPyObject)]
pub struct PySeen<'py>(
    u32,
    PyReadonlyArray1<'py, i32>,
    PyCounts<'py>,
    PyFloats<'py>,
    PyFloats<'py>,
);

impl PySeen<'_> {
    fn view(&self) -> PyResult<Seen<'_>> {
        let threshold = Threshold::new(self.0).map_err(to_python)?;
        Seen::new(
            threshold,
            self.1.as_slice()?,
            self.2.view()?,
            self.3.view()?,
            self.4.view()?,
        )
        .map_err(to_python)
    }
}

#[pyfunction]
#[pyo3(signature = (readings, light, threads))]
pub fn log_likelihood(
    py: Python<'_>,
    readings: PySeen<'_>,
    light: PyReadonlyArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<f64> {
    let (readings, light) = (readings.view()?, light.as_slice()?);
    run(py, threads, || readings.value(light))
}

#[pyfunction]
#[pyo3(signature = (readings, light, gradient, curvature, threads))]
pub fn likelihood_gradient_and_curvature(
    py: Python<'_>,
    readings: PySeen<'_>,
    light: PyReadonlyArray1<'_, f64>,
    mut gradient: PyReadwriteArray1<'_, f64>,
    mut curvature: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (readings, light) = (readings.view()?, light.as_slice()?);
    let (gradient, curvature) = (gradient.as_slice_mut()?, curvature.as_slice_mut()?);
    run(py, threads, || readings.slopes(light, gradient, curvature))
}

#[pyfunction]
#[pyo3(signature = (readings, light, information, threads))]
pub fn likelihood_information(
    py: Python<'_>,
    readings: PySeen<'_>,
    light: PyReadonlyArray1<'_, f64>,
    mut information: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (readings, light, information) = (
        readings.view()?,
        light.as_slice()?,
        information.as_slice_mut()?,
    );
    run(py, threads, || readings.information(light, information))
}

#[pyfunction]
#[pyo3(signature = (readings, penalty, max_light, guess, point, threads))]
pub fn likelihood_proximal(
    py: Python<'_>,
    readings: PySeen<'_>,
    penalty: f64,
    max_light: f64,
    guess: PyReadonlyArray1<'_, f64>,
    mut point: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (readings, guess, point) = (readings.view()?, guess.as_slice()?, point.as_slice_mut()?);
    run(py, threads, || {
        readings.proximal(penalty, max_light, guess, point)
    })
}

#[pyfunction]
#[pyo3(signature = (readings, step, max_light, light, x, dual, threads))]
#[allow(clippy::too_many_arguments)]
pub fn likelihood_admm_update(
    py: Python<'_>,
    readings: PySeen<'_>,
    step: PyStep,
    max_light: f64,
    light: PyReadonlyArray1<'_, f64>,
    mut x: PyReadwriteArray1<'_, f64>,
    mut dual: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<f64> {
    let (readings, light) = (readings.view()?, light.as_slice()?);
    let (x, dual) = (x.as_slice_mut()?, dual.as_slice_mut()?);
    run(py, threads, || {
        readings.split(&step_of(step), max_light, light, x, dual)
    })
}

/// (penalty, relaxation).
pub type PyStep = (f64, f64);

pub fn step_of((penalty, relaxation): PyStep) -> Step {
    Step {
        penalty,
        relaxation,
    }
}
