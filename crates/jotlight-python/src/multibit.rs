//! Readings of several bits, and read noise.

use jotlight::multibit::{self, Cells, Response, Sample};
use jotlight::sensing::draw_images;
use numpy::{
    PyReadonlyArray1, PyReadwriteArray1, PyReadwriteArray2, PyReadwriteArray4,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arguments::{PyImages, PyValues, check_length, to_engine_images};
use crate::sensing::{PySensor, to_window};
use crate::{run, to_python};

/// A response, as the tuple (highest reading, read noise, threshold).
#[derive(FromPyObject)]
pub struct PyResponse(u32, f64, u32);

impl PyResponse {
    pub fn to_engine(&self) -> PyResult<Response> {
        Response::new(self.0, self.1, self.2).map_err(to_python)
    }
}

/// The readings of cells, as the tuple (whether they are histograms, numbers, efficiency, dark
/// counts).
#[derive(FromPyObject)]
pub struct PyCells<'py>(
    bool,
    PyReadonlyArray1<'py, i32>,
    PyValues<'py, f64>,
    PyValues<'py, f64>,
);

impl PyCells<'_> {
    pub fn to_engine<'a>(&'a self, response: &'a Response, number: usize) -> PyResult<Cells<'a>> {
        let values = self.1.as_slice()?;
        let sample = if self.0 {
            Sample::Histograms(values)
        } else {
            Sample::Readings(values)
        };
        let (efficiency, dark_counts) = (self.2.to_engine()?, self.3.to_engine()?);
        Cells::new(response, sample, number, efficiency, dark_counts).map_err(to_python)
    }
}

/// Draw the readings of a window of frames, rows, and columns of the images `(N, H, W)` into `out`
/// `(N, frames, rows, columns)`. Each image has its seed and channel.
#[pyfunction]
pub fn draw_readings(
    py: Python<'_>,
    sensor: PySensor<'_>,
    response: PyResponse,
    images: PyImages<'_>,
    streams: Vec<([u8; 32], usize)>,
    frames: (usize, usize),
    rows: (usize, usize),
    columns: (usize, usize),
    mut out: PyReadwriteArray4<'_, u16>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (sensor, response) = (sensor.to_engine()?, response.to_engine()?);
    let (images, window) = (to_engine_images(&images), to_window(frames, rows, columns));
    let out = out.as_array_mut();
    run(py, threads, || {
        draw_images(images, &streams, out, |image, (seed, channel), out| {
            multibit::draw(&sensor, &response, image, seed, channel, &window, out)
        })
    })
}

/// Return the log-likelihood of cells, where `light` is the light of each.
#[pyfunction]
pub fn readings_log_likelihood(
    py: Python<'_>,
    response: PyResponse,
    cells: PyCells<'_>,
    light: PyReadonlyArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<f64> {
    let (response, light) = (response.to_engine()?, light.as_slice()?);
    let cells = cells.to_engine(&response, light.len())?;
    run(py, threads, || cells.value(light))
}

/// Write the derivative of the log-likelihood of each cell about its light into `gradient`, and
/// minus the second one into `curvature`.
#[pyfunction]
pub fn readings_gradient_and_curvature(
    py: Python<'_>,
    response: PyResponse,
    cells: PyCells<'_>,
    light: PyReadonlyArray1<'_, f64>,
    mut gradient: PyReadwriteArray1<'_, f64>,
    mut curvature: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (response, light) = (response.to_engine()?, light.as_slice()?);
    let cells = cells.to_engine(&response, light.len())?;
    let (gradient, curvature) = (gradient.as_slice_mut()?, curvature.as_slice_mut()?);
    run(py, threads, || {
        cells.gradient_and_curvature(light, gradient, curvature)
    })
}

/// Write log P(R = reading) at each rate into `out`.
#[pyfunction]
pub fn readings_log_probability(
    py: Python<'_>,
    response: PyResponse,
    readings: PyReadonlyArray1<'_, i32>,
    rates: PyReadonlyArray1<'_, f64>,
    mut out: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (response, rates) = (response.to_engine()?, rates.as_slice()?);
    let (readings, out) = (readings.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        response.ln_probabilities(readings, rates, out)
    })
}

/// Write P(R = r) at each rate into `out` `(rates, length)`, for r = 0, 1, …, and 0 beyond the
/// highest reading.
#[pyfunction]
pub fn readings_distribution(
    py: Python<'_>,
    response: PyResponse,
    rates: PyReadonlyArray1<'_, f64>,
    mut out: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (response, rates) = (response.to_engine()?, rates.as_slice()?);
    let length = out.shape()[1];
    let out = out.as_slice_mut()?;
    run(py, threads, || response.distributions(rates, length, out))
}

/// Write the Fisher information of a reading about each rate into `information`.
#[pyfunction]
pub fn readings_information(
    py: Python<'_>,
    response: PyResponse,
    rates: PyReadonlyArray1<'_, f64>,
    mut information: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (response, rates) = (response.to_engine()?, rates.as_slice()?);
    let information = information.as_slice_mut()?;
    run(py, threads, || response.informations(rates, information))
}

/// Write the mean of a reading, its variance, and the derivative of the mean at each rate into
/// `moments` `(rates, 3)`.
#[pyfunction]
pub fn readings_moments(
    py: Python<'_>,
    response: PyResponse,
    rates: PyReadonlyArray1<'_, f64>,
    mut moments: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (response, rates) = (response.to_engine()?, rates.as_slice()?);
    check_length("moments", 3 * rates.len(), moments.len())?;
    let moments = moments.as_slice_mut()?.as_chunks_mut().0;
    run(py, threads, || response.all_moments(rates, moments))
}
