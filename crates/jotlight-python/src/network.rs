use jotlight::bits::PackedBits;
use jotlight::network::{self, Batch, Layer, Patch, Real, Splines, Wiring};
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3,
    PyReadonlyArray4,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::sensing::PySensor;
use crate::{run, to_python};

/// (filters, coefficients, first knot, knot spacing, (stride, upsampling, layer read, layer added)).
type PyLayer<'py, F> = (
    PyReadonlyArray4<'py, F>,
    Option<PyReadonlyArray2<'py, F>>,
    f64,
    f64,
    (usize, usize, Option<usize>, Option<usize>),
);

fn to_engine<F: Real + Element>(layers: &[PyLayer<'_, F>]) -> PyResult<Vec<Layer<F>>> {
    layers.iter().map(one_to_engine).collect()
}

fn one_to_engine<F: Real + Element>(layer: &PyLayer<'_, F>) -> PyResult<Layer<F>> {
    let (filters, coefficients, start, spacing, wiring) = layer;
    let &(stride, upsampling, reads, adds) = wiring;
    let wiring = Wiring {
        stride,
        upsampling,
        reads,
        adds,
    };
    Layer::new(
        filters.as_array().to_owned(),
        coefficients.as_ref().map(PyReadonlyArray2::as_array),
        F::from_f64(*start),
        F::from_f64(*spacing),
        wiring,
    )
    .map_err(to_python)
}

/// A layer whose filters are brought into order once.
#[pyclass(frozen, name = "Layer")]
pub struct Prepared(Layer<f32>);

#[pymethods]
impl Prepared {
    #[new]
    fn new(layer: PyLayer<'_, f32>) -> PyResult<Self> {
        Ok(Self(one_to_engine(&layer)?))
    }
}

/// What they hold, also for threads that do not have Python's lock.
fn prepared(layers: &[Py<Prepared>]) -> Vec<&Layer<f32>> {
    layers.iter().map(|layer| &layer.get().0).collect()
}

#[pyfunction]
#[pyo3(signature = (layer, packed, width, valid, threads))]
pub fn masked_sums<'py>(
    py: Python<'py>,
    layer: Py<Prepared>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    valid: PyReadonlyArray2<'_, u8>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (packed, valid) = (packed.as_array(), valid.as_array());
    let sums = run(py, threads, || {
        network::masked_sums(&layer.get().0, &PackedBits::new(packed, width)?, valid)
    })?;
    Ok(sums.into_pyarray(py))
}

#[pyfunction]
#[pyo3(signature = (layers, sums, threads))]
pub fn forward<'py>(
    py: Python<'py>,
    layers: Vec<Py<Prepared>>,
    sums: PyReadonlyArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let layers = prepared(&layers);
    let sums = sums.as_array();
    let picture = run(py, threads, || network::forward(&layers, sums))?;
    Ok(picture.into_pyarray(py))
}

#[pyfunction]
#[pyo3(signature = (layers, counts, sums, threads))]
pub fn forward_counts<'py>(
    py: Python<'py>,
    layers: Vec<Py<Prepared>>,
    counts: PyReadonlyArray2<'_, i32>,
    sums: PyReadonlyArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let layers = prepared(&layers);
    let (counts, sums) = (counts.as_array(), sums.as_array());
    let picture = run(py, threads, || {
        network::forward_counts(&layers, counts, sums)
    })?;
    Ok(picture.into_pyarray(py))
}

#[pyfunction]
#[pyo3(signature = (layers, packed, width, threads))]
pub fn forward_bits<'py>(
    py: Python<'py>,
    layers: Vec<Py<Prepared>>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (layers, packed) = (prepared(&layers), packed.as_array());
    let picture = run(py, threads, || {
        network::forward_bits(&layers, &PackedBits::new(packed, width)?)
    })?;
    Ok(picture.into_pyarray(py))
}

/// The rows of the data that rows of a picture are made of, first and last.
#[pyfunction]
#[pyo3(signature = (layers, height, rows))]
pub fn rows_needed(
    layers: Vec<Py<Prepared>>,
    height: usize,
    rows: (usize, usize),
) -> PyResult<(usize, usize)> {
    let needed = network::rows_needed(&prepared(&layers), height, rows.0..rows.1);
    let needed = needed.map_err(to_python)?;
    Ok((needed.start, needed.end))
}

/// Layers in either width.
#[derive(FromPyObject)]
pub enum PyLayers<'py> {
    F32(Vec<PyLayer<'py, f32>>),
    F64(Vec<PyLayer<'py, f64>>),
}

/// Scenes of one size in one array, or of any size each in its own.
#[derive(FromPyObject)]
pub enum PyImages<'py> {
    Stack(PyReadonlyArray3<'py, f32>),
    Each(Vec<PyReadonlyArray2<'py, f32>>),
}

/// The keyword arguments that describe a batch; each row of `patches` is an image, first and last row, first and last column.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PyBatch<'py> {
    sensor: PySensor<'py>,
    frames: usize,
    images: PyImages<'py>,
    patches: PyReadonlyArray2<'py, i64>,
    border: usize,
    seed: [u8; 32],
}

impl PyBatch<'_> {
    fn view(&self) -> PyResult<Batch<'_>> {
        let images = match &self.images {
            PyImages::Stack(stack) => {
                let stack = stack.as_array();
                (0..stack.dim().0)
                    .map(|index| stack.index_axis_move(numpy::ndarray::Axis(0), index))
                    .collect()
            }
            PyImages::Each(images) => images.iter().map(|image| image.as_array()).collect(),
        };
        let patches = self.patches.as_array();
        if patches.ncols() != 5 || patches.iter().any(|&place| place < 0) {
            return Err(PyValueError::new_err(
                "patches: expected rows of image, first and last row, first and last column, all 0 or more",
            ));
        }
        let patches = patches
            .rows()
            .into_iter()
            .map(|row| {
                let place = |index: usize| row[index].cast_unsigned() as usize;
                Patch {
                    image: place(0),
                    rows: place(1)..place(2),
                    columns: place(3)..place(4),
                }
            })
            .collect();
        Ok(Batch {
            sensor: self.sensor.to_engine()?,
            frames: self.frames,
            images,
            patches,
            border: self.border,
            seed: self.seed,
        })
    }
}

type Errors<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);

fn to_errors(py: Python<'_>, errors: Vec<f64>, pixels: Vec<usize>) -> Errors<'_> {
    let pixels: Vec<i64> = pixels.into_iter().map(|n| n as i64).collect();
    (errors.into_pyarray(py), pixels.into_pyarray(py))
}

#[pyfunction]
#[pyo3(signature = (layers, batch, threads))]
pub fn errors<'py>(
    py: Python<'py>,
    layers: PyLayers<'py>,
    batch: PyBatch<'py>,
    threads: Option<isize>,
) -> PyResult<Errors<'py>> {
    let batch = batch.view()?;
    let (errors, pixels) = match layers {
        PyLayers::F32(layers) => {
            let layers = to_engine(&layers)?;
            run(py, threads, || batch.errors(&layers))
        }
        PyLayers::F64(layers) => {
            let layers = to_engine(&layers)?;
            run(py, threads, || batch.errors(&layers))
        }
    }?;
    Ok(to_errors(py, errors, pixels))
}

#[pyfunction]
#[pyo3(signature = (layers, batch, threads))]
pub fn gradient<'py>(
    py: Python<'py>,
    layers: PyLayers<'py>,
    batch: PyBatch<'py>,
    threads: Option<isize>,
) -> PyResult<(Errors<'py>, Bound<'py, PyArray1<f64>>)> {
    let batch = batch.view()?;
    let all = match layers {
        PyLayers::F32(layers) => {
            let layers = to_engine(&layers)?;
            run(py, threads, || batch.gradient(&layers))
        }
        PyLayers::F64(layers) => {
            let layers = to_engine(&layers)?;
            run(py, threads, || batch.gradient(&layers))
        }
    }?;
    Ok((
        to_errors(py, all.errors, all.pixels),
        all.gradient.into_pyarray(py),
    ))
}

#[pyfunction]
#[pyo3(signature = (layers, batch, threads))]
#[allow(clippy::type_complexity)]
pub fn normal_equations<'py>(
    py: Python<'py>,
    layers: PyLayers<'py>,
    batch: PyBatch<'py>,
    threads: Option<isize>,
) -> PyResult<(
    Errors<'py>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
)> {
    let batch = batch.view()?;
    let all = match layers {
        PyLayers::F32(layers) => {
            let layers = to_engine(&layers)?;
            run(py, threads, || batch.normal_equations(&layers))
        }
        PyLayers::F64(layers) => {
            let layers = to_engine(&layers)?;
            run(py, threads, || batch.normal_equations(&layers))
        }
    }?;
    let gradient = all.gradient;
    Ok((
        to_errors(py, gradient.errors, gradient.pixels),
        gradient.gradient.into_pyarray(py),
        all.matrix.into_pyarray(py),
    ))
}

/// Planes (N, C, P) in either width, each with its splines' coefficients.
#[derive(FromPyObject)]
pub enum PyPlanes<'py> {
    F32(PyReadonlyArray3<'py, f32>, PyReadonlyArray2<'py, f32>),
    F64(PyReadonlyArray3<'py, f64>, PyReadonlyArray2<'py, f64>),
}

fn bent<'py, F: Real + Element>(
    py: Python<'py>,
    (planes, coefficients): (PyReadonlyArray3<'_, F>, PyReadonlyArray2<'_, F>),
    (start, spacing): (f64, f64),
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyAny>> {
    let (planes, coefficients) = (planes.as_array(), coefficients.as_array());
    let out = run(py, threads, || {
        Splines::new(coefficients, F::from_f64(start), F::from_f64(spacing))?.bend(planes)
    })?;
    Ok(out.into_pyarray(py).into_any())
}

#[pyfunction]
#[pyo3(signature = (planes, start, spacing, threads))]
pub fn bend<'py>(
    py: Python<'py>,
    planes: PyPlanes<'py>,
    start: f64,
    spacing: f64,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyAny>> {
    let knots = (start, spacing);
    match planes {
        PyPlanes::F32(planes, coefficients) => bent(py, (planes, coefficients), knots, threads),
        PyPlanes::F64(planes, coefficients) => bent(py, (planes, coefficients), knots, threads),
    }
}

type Pushed<'py> = (Bound<'py, PyAny>, Bound<'py, PyArray2<f64>>);

fn pushed<'py, F: Real + Element>(
    py: Python<'py>,
    (planes, coefficients): (PyReadonlyArray3<'_, F>, PyReadonlyArray2<'_, F>),
    gradient: PyReadonlyArray3<'_, F>,
    (start, spacing): (f64, f64),
    threads: Option<isize>,
) -> PyResult<Pushed<'py>> {
    let (planes, coefficients) = (planes.as_array(), coefficients.as_array());
    let gradient = gradient.as_array();
    let (out, sums) = run(py, threads, || {
        Splines::new(coefficients, F::from_f64(start), F::from_f64(spacing))?.push(planes, gradient)
    })?;
    Ok((out.into_pyarray(py).into_any(), sums.into_pyarray(py)))
}

/// Gradients in either width.
#[derive(FromPyObject)]
pub enum PyGradient<'py> {
    F32(PyReadonlyArray3<'py, f32>),
    F64(PyReadonlyArray3<'py, f64>),
}

#[pyfunction]
#[pyo3(signature = (planes, gradient, start, spacing, threads))]
pub fn push_bend<'py>(
    py: Python<'py>,
    planes: PyPlanes<'py>,
    gradient: PyGradient<'py>,
    start: f64,
    spacing: f64,
    threads: Option<isize>,
) -> PyResult<Pushed<'py>> {
    let knots = (start, spacing);
    match (planes, gradient) {
        (PyPlanes::F32(planes, coefficients), PyGradient::F32(gradient)) => {
            pushed(py, (planes, coefficients), gradient, knots, threads)
        }
        (PyPlanes::F64(planes, coefficients), PyGradient::F64(gradient)) => {
            pushed(py, (planes, coefficients), gradient, knots, threads)
        }
        _ => Err(PyValueError::new_err(
            "gradient: expected numbers of the same width as the planes",
        )),
    }
}
