use jotlight::likelihood::Threshold;
use jotlight::sensing::{self, Image, Kernel, PerJot, Sensor, Spread, Window};
use numpy::{PyReadonlyArray2, PyReadwriteArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use crate::{run, to_python};

#[derive(FromPyObject)]
pub enum PyImage<'py> {
    F32(PyReadonlyArray2<'py, f32>),
    F64(PyReadonlyArray2<'py, f64>),
}

impl PyImage<'_> {
    fn view(&self) -> Image<'_> {
        match self {
            Self::F32(image) => Image::F32(image.as_array()),
            Self::F64(image) => Image::F64(image.as_array()),
        }
    }
}

#[derive(FromPyObject)]
pub enum PyPerJot<'py> {
    Same(f64),
    Map(PyReadonlyArray2<'py, f32>),
}

impl PyPerJot<'_> {
    fn view(&self) -> PerJot<'_> {
        match self {
            Self::Same(value) => PerJot::Same(*value),
            Self::Map(map) => PerJot::Map(map.as_array()),
        }
    }
}

/// The keyword arguments that describe a sensor, as `Sensor._engine_arguments` gives them.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PySensor<'py> {
    oversampling: usize,
    kernel_degree: usize,
    gain_per_frame: f64,
    efficiency: PyPerJot<'py>,
    dark_counts: PyPerJot<'py>,
    dead: Option<PyReadonlyArray2<'py, bool>>,
    threshold: u32,
}

impl PySensor<'_> {
    pub fn view(&self) -> PyResult<Sensor<'_>> {
        Ok(Sensor {
            kernel: Kernel::new(self.kernel_degree, self.oversampling).map_err(to_python)?,
            gain_per_frame: self.gain_per_frame,
            efficiency: self.efficiency.view(),
            dark_counts: self.dark_counts.view(),
            dead: self.dead.as_ref().map(|dead| dead.as_array()),
            threshold: Threshold::new(self.threshold).map_err(to_python)?,
        })
    }
}

#[pyfunction]
#[pyo3(signature = (sensor, image, seed, channel, frames, rows, columns, out, threads))]
#[allow(clippy::too_many_arguments)]
pub fn expose(
    py: Python<'_>,
    sensor: PySensor<'_>,
    image: PyImage<'_>,
    seed: [u8; 32],
    channel: usize,
    frames: (usize, usize),
    rows: (usize, usize),
    columns: (usize, usize),
    mut out: PyReadwriteArray3<'_, u8>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (sensor, image, out) = (sensor.view()?, image.view(), out.as_array_mut());
    let window = Window {
        frames: frames.0..frames.1,
        rows: rows.0..rows.1,
        columns: columns.0..columns.1,
    };
    run(py, threads, || {
        sensing::expose(&sensor, image, seed, channel, &window, out)
    })
}

#[pyfunction]
#[pyo3(signature = (sensor, image, first, out, threads))]
pub fn rate(
    py: Python<'_>,
    sensor: PySensor<'_>,
    image: PyImage<'_>,
    first: usize,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (sensor, image, out) = (sensor.view()?, image.view(), out.as_array_mut());
    run(py, threads, || sensing::rate(&sensor, image, first, out))
}

#[pyfunction]
#[pyo3(signature = (sensor, image, first, out, threads))]
pub fn probability(
    py: Python<'_>,
    sensor: PySensor<'_>,
    image: PyImage<'_>,
    first: usize,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (sensor, image, out) = (sensor.view()?, image.view(), out.as_array_mut());
    run(py, threads, || {
        sensing::probability(&sensor, image, first, out)
    })
}

/// (degree, K̂) of the kernels down the columns and along the rows, and the gain.
type PySpread = ((usize, usize), (usize, usize), f64);

fn spread_of((down, along, gain): PySpread) -> PyResult<(Spread, f64)> {
    let down = Kernel::new(down.0, down.1).map_err(to_python)?;
    let along = Kernel::new(along.0, along.1).map_err(to_python)?;
    Ok((Spread::new(down, along), gain))
}

#[pyfunction]
#[pyo3(signature = (spread, image, out, threads))]
pub fn spread_forward(
    py: Python<'_>,
    spread: PySpread,
    image: PyReadonlyArray2<'_, f64>,
    mut out: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (spread, gain) = spread_of(spread)?;
    let (image, out) = (image.as_array(), out.as_array_mut());
    run(py, threads, || spread.forward(gain, image, out))
}

#[pyfunction]
#[pyo3(signature = (spread, jots, out, threads))]
pub fn spread_adjoint(
    py: Python<'_>,
    spread: PySpread,
    jots: PyReadonlyArray2<'_, f64>,
    mut out: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (spread, gain) = spread_of(spread)?;
    let (jots, out) = (jots.as_array(), out.as_array_mut());
    run(py, threads, || spread.adjoint(gain, jots, out))
}

#[pyfunction]
#[pyo3(signature = (spread, weights, image, out, threads))]
pub fn spread_normal(
    py: Python<'_>,
    spread: PySpread,
    weights: PyReadonlyArray2<'_, f64>,
    image: PyReadonlyArray2<'_, f64>,
    mut out: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (spread, gain) = spread_of(spread)?;
    let (weights, image, out) = (weights.as_array(), image.as_array(), out.as_array_mut());
    run(py, threads, || spread.normal(gain, weights, image, out))
}

#[pyfunction]
pub fn kernel_taps(degree: usize, oversampling: usize) -> PyResult<Vec<f64>> {
    let kernel = Kernel::new(degree, oversampling).map_err(to_python)?;
    Ok(kernel.taps().to_vec())
}

#[pyfunction]
pub fn detection_probability(threshold: u32, rate: f64) -> PyResult<f64> {
    Ok(Threshold::new(threshold).map_err(to_python)?.fires(rate))
}

#[pyfunction]
pub fn inverse_detection_probability(threshold: u32, probability: f64) -> PyResult<f64> {
    Ok(Threshold::new(threshold)
        .map_err(to_python)?
        .rate(probability))
}
