//! The sensor model: random bits, rates, detection probabilities, and the operator G.

use jotlight::likelihood::Threshold;
use jotlight::numbers::inner_product;
use jotlight::sensing::{self, Kernel, Sensor, SpreadOperator, Window};
use numpy::{
    PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3, PyReadwriteArray4,
};
use pyo3::prelude::*;

use crate::arguments::{PyImage, PyImages, PyPerJot, check_length, to_engine_images};
use crate::{run, run_alone, to_python};

/// A sensor, as a dictionary.
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
    pub fn to_engine(&self) -> PyResult<Sensor<'_>> {
        Ok(Sensor {
            kernel: Kernel::new(self.kernel_degree, self.oversampling).map_err(to_python)?,
            gain_per_frame: self.gain_per_frame,
            efficiency: self.efficiency.to_engine(),
            dark_counts: self.dark_counts.to_engine(),
            dead: self.dead.as_ref().map(|dead| dead.as_array()),
            threshold: Threshold::new(self.threshold).map_err(to_python)?,
        })
    }
}

/// Draw the bits of a window of frames, rows, and columns of the images `(N, H, W)` into `out`
/// `(N, frames, rows, bytes)`. Each image has its seed and channel.
#[pyfunction]
pub fn expose(
    py: Python<'_>,
    sensor: PySensor<'_>,
    images: PyImages<'_>,
    streams: Vec<([u8; 32], usize)>,
    frames: (usize, usize),
    rows: (usize, usize),
    columns: (usize, usize),
    mut out: PyReadwriteArray4<'_, u8>,
    threads: Option<isize>,
) -> PyResult<()> {
    let sensor = sensor.to_engine()?;
    let (images, window) = (to_engine_images(&images), to_window(frames, rows, columns));
    let out = out.as_array_mut();
    run(py, threads, || {
        sensing::draw_images(images, &streams, out, |image, (seed, channel), out| {
            sensing::expose(&sensor, image, seed, channel, &window, out)
        })
    })
}

/// Return the window of ranges of frames, rows of pixels, and columns of pixels.
pub fn to_window(frames: (usize, usize), rows: (usize, usize), columns: (usize, usize)) -> Window {
    Window {
        frames: frames.0..frames.1,
        rows: rows.0..rows.1,
        columns: columns.0..columns.1,
    }
}

/// Draw the counts of `frames` frames of an image `(H, W)` into `out`. Counts with different numbers
/// `index` are independent.
#[pyfunction]
pub fn draw_counts(
    py: Python<'_>,
    sensor: PySensor<'_>,
    frames: usize,
    image: PyImage<'_>,
    seed: [u8; 32],
    index: usize,
    mut out: PyReadwriteArray2<'_, i32>,
) -> PyResult<()> {
    let (sensor, image, out) = (sensor.to_engine()?, image.to_engine(), out.as_array_mut());
    run_alone(py, || {
        sensing::draw_counts(&sensor, frames, image, seed, index, out)
    })
}

/// Write the rates of rows of jots into `out`. The first row of `out` is the row `first` of jots.
#[pyfunction]
pub fn rate(
    py: Python<'_>,
    sensor: PySensor<'_>,
    image: PyImage<'_>,
    first: usize,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (sensor, image, out) = (sensor.to_engine()?, image.to_engine(), out.as_array_mut());
    run(py, threads, || sensing::rate(&sensor, image, first, out))
}

/// Write the detection probabilities of rows of jots into `out`. The first row of `out` is the row
/// `first` of jots.
#[pyfunction]
pub fn probability(
    py: Python<'_>,
    sensor: PySensor<'_>,
    image: PyImage<'_>,
    first: usize,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (sensor, image, out) = (sensor.to_engine()?, image.to_engine(), out.as_array_mut());
    run(py, threads, || {
        sensing::probability(&sensor, image, first, out)
    })
}

/// The operator gain · G, as the tuple (vertical kernel, horizontal kernel, gain). A kernel is the
/// tuple (degree, K̂).
#[derive(FromPyObject)]
pub struct PySpread((usize, usize), (usize, usize), f64);

impl PySpread {
    fn to_engine(&self) -> PyResult<(SpreadOperator, f64)> {
        let kernel = |(degree, oversampling)| Kernel::new(degree, oversampling).map_err(to_python);
        Ok((
            SpreadOperator::new(kernel(self.0)?, kernel(self.1)?),
            self.2,
        ))
    }
}

/// Write gain · G of each image `(N, H, W)` into `out`.
#[pyfunction]
pub fn spread_forward(
    py: Python<'_>,
    spread: PySpread,
    images: PyReadonlyArray3<'_, f64>,
    mut out: PyReadwriteArray3<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (spread, gain) = spread.to_engine()?;
    let (images, out) = (images.as_array(), out.as_array_mut());
    run(py, threads, || spread.forward(gain, images, out))
}

/// Write gain · Gᵀ of the jots of each image `(N, H·K̂, W·K̂)` into `out`.
#[pyfunction]
pub fn spread_adjoint(
    py: Python<'_>,
    spread: PySpread,
    jots: PyReadonlyArray3<'_, f64>,
    mut out: PyReadwriteArray3<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (spread, gain) = spread.to_engine()?;
    let (jots, out) = (jots.as_array(), out.as_array_mut());
    run(py, threads, || spread.adjoint(gain, jots, out))
}

/// Write gain² · Gᵀ diag(weights) G of each image `(N, H, W)` into `out`.
#[pyfunction]
pub fn spread_normal(
    py: Python<'_>,
    spread: PySpread,
    weights: PyReadonlyArray3<'_, f64>,
    images: PyReadonlyArray3<'_, f64>,
    mut out: PyReadwriteArray3<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (spread, gain) = spread.to_engine()?;
    let (weights, images, out) = (weights.as_array(), images.as_array(), out.as_array_mut());
    run(py, threads, || spread.normal(gain, weights, images, out))
}

/// Return the inner product of each row of `a` with the same row of `b`. One thread computes them,
/// because starting others would take longer.
#[pyfunction]
pub fn inner_products(
    py: Python<'_>,
    a: PyReadonlyArray2<'_, f64>,
    b: PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<f64>> {
    let (rows, columns) = a.as_array().dim();
    let (a, b) = (a.as_slice()?, b.as_slice()?);
    check_length("b", a.len(), b.len())?;
    let row = |row: usize| row * columns..(row + 1) * columns;
    Ok(py.detach(|| {
        let products = (0..rows).map(|index| inner_product(&a[row(index)], &b[row(index)]));
        products.collect()
    }))
}

/// Return the integrals g of a B-spline kernel over the jots.
#[pyfunction]
pub fn kernel_taps(degree: usize, oversampling: usize) -> PyResult<Vec<f64>> {
    let kernel = Kernel::new(degree, oversampling).map_err(to_python)?;
    Ok(kernel.taps().to_vec())
}
