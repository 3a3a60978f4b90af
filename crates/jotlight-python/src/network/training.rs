//! The cost of a network on a batch, its gradient, and its normal equations.

use jotlight::network::{Batch, Compiled, Patch};
use ndarray::Axis;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::layers::{PyLayer, all_to_engine};
use crate::arguments::{Precision, for_precision};
use crate::run;
use crate::sensing::PySensor;

type PyLayers<'py> = Precision<Vec<PyLayer<'py, f32>>, Vec<PyLayer<'py, f64>>>;

/// Ground-truth images: one array of images of the same size, or a list of arrays.
#[derive(FromPyObject)]
pub enum PyImages<'py> {
    Stack(PyReadonlyArray3<'py, f32>),
    Each(Vec<PyReadonlyArray2<'py, f32>>),
}

/// A batch, as a dictionary. Each row of `patches` holds the index of an image, the first row, the
/// end of the rows, the first column, and the end of the columns.
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
    fn to_engine(&self) -> PyResult<Batch<'_>> {
        let images = match &self.images {
            PyImages::Stack(stack) => {
                let stack = stack.as_array();
                (0..stack.dim().0)
                    .map(|index| stack.index_axis_move(Axis(0), index))
                    .collect()
            }
            PyImages::Each(images) => images.iter().map(|image| image.as_array()).collect(),
        };
        let patches = self.patches.as_array();
        if patches.ncols() != 5 || patches.iter().any(|&value| value < 0) {
            return Err(PyValueError::new_err(
                "patches: expected rows of five integers of at least 0: image index, first row, \
                 end of rows, first column, end of columns",
            ));
        }
        let patches = patches
            .rows()
            .into_iter()
            .map(|row| {
                let value = |index: usize| row[index].cast_unsigned() as usize;
                Patch {
                    image: value(0),
                    rows: value(1)..value(2),
                    columns: value(3)..value(4),
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

/// The squared error of each patch, and the number of pixels in its sum.
type SquaredErrors<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);

type Vector<'py> = Bound<'py, PyArray1<f64>>;

type Matrix<'py> = Bound<'py, PyArray2<f64>>;

fn to_arrays(py: Python<'_>, squared_errors: Vec<f64>, pixels: Vec<usize>) -> SquaredErrors<'_> {
    let pixels: Vec<i64> = pixels.into_iter().map(|n| n as i64).collect();
    (squared_errors.into_pyarray(py), pixels.into_pyarray(py))
}

/// Return the squared error of each patch, and the number of pixels in its sum.
#[pyfunction]
pub fn squared_errors<'py>(
    py: Python<'py>,
    layers: PyLayers<'py>,
    batch: PyBatch<'py>,
    threads: Option<isize>,
) -> PyResult<SquaredErrors<'py>> {
    let batch = batch.to_engine()?;
    let (squared_errors, pixels) = for_precision!(layers, layers => {
        let layers = all_to_engine(&layers)?;
        run(py, threads, || Compiled::squared_errors(&batch, &layers))
    })?;
    Ok(to_arrays(py, squared_errors, pixels))
}

/// Return the squared errors, and the gradient of the cost.
#[pyfunction]
pub fn gradient<'py>(
    py: Python<'py>,
    layers: PyLayers<'py>,
    batch: PyBatch<'py>,
    threads: Option<isize>,
) -> PyResult<(SquaredErrors<'py>, Vector<'py>)> {
    let batch = batch.to_engine()?;
    let result = for_precision!(layers, layers => {
        let layers = all_to_engine(&layers)?;
        run(py, threads, || Compiled::gradient(&batch, &layers))
    })?;
    let squared_errors = to_arrays(py, result.squared_errors, result.pixels);
    Ok((squared_errors, result.gradient.into_pyarray(py)))
}

/// Return the squared errors, the gradient of the cost, and the matrix of the normal equations.
#[pyfunction]
pub fn normal_equations<'py>(
    py: Python<'py>,
    layers: PyLayers<'py>,
    batch: PyBatch<'py>,
    threads: Option<isize>,
) -> PyResult<(SquaredErrors<'py>, Vector<'py>, Matrix<'py>)> {
    let batch = batch.to_engine()?;
    let result = for_precision!(layers, layers => {
        let layers = all_to_engine(&layers)?;
        run(py, threads, || Compiled::normal_equations(&batch, &layers))
    })?;
    let gradient = result.gradient;
    let squared_errors = to_arrays(py, gradient.squared_errors, gradient.pixels);
    let gradient = gradient.gradient.into_pyarray(py);
    Ok((squared_errors, gradient, result.matrix.into_pyarray(py)))
}
