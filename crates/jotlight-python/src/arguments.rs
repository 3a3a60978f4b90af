//! The types of Python arguments that several functions share, and their conversion to types of the
//! engine.

use jotlight::admm::AdmmStep;
use jotlight::sensing::{Image, PerJot};
use jotlight::values::Values;
use ndarray::{ArrayView2, ArrayView3, Axis};
use numpy::{Element, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// One value for all elements, or an array with one value per element.
#[derive(FromPyObject)]
pub enum ValueOrArray<Value, Array> {
    Value(Value),
    Array(Array),
}

/// An argument whose arrays are all `f32` or all `f64`.
#[derive(FromPyObject)]
pub enum Precision<Single, Double> {
    F32(Single),
    F64(Double),
}

/// Evaluate an expression with the arrays of a [`Precision`] argument, whatever their type:
/// `for_precision!(layers, layers => expression)`.
macro_rules! for_precision {
    ($argument:expr, $name:ident => $expression:expr) => {
        match $argument {
            $crate::arguments::Precision::F32($name) => $expression,
            $crate::arguments::Precision::F64($name) => $expression,
        }
    };
}
pub(crate) use for_precision;

/// One value, or a one-dimensional array of the same type.
pub type PyValues<'py, T> = ValueOrArray<T, PyReadonlyArray1<'py, T>>;

/// One number for all jots, or a map with one number per jot.
pub type PyPerJot<'py> = ValueOrArray<f64, PyReadonlyArray2<'py, f32>>;

/// A two-dimensional image.
pub type PyImage<'py> = Precision<PyReadonlyArray2<'py, f32>, PyReadonlyArray2<'py, f64>>;

/// Images of the same size, `(N, H, W)`.
pub type PyImages<'py> = Precision<PyReadonlyArray3<'py, f32>, PyReadonlyArray3<'py, f64>>;

/// Return the single images.
pub fn to_engine_images<'a>(images: &'a PyImages<'_>) -> Vec<Image<'a>> {
    match images {
        Precision::F32(images) => split(images.as_array()).map(Image::F32).collect(),
        Precision::F64(images) => split(images.as_array()).map(Image::F64).collect(),
    }
}

fn split<T>(images: ArrayView3<'_, T>) -> impl Iterator<Item = ArrayView2<'_, T>> {
    (0..images.dim().0).map(move |image| images.index_axis_move(Axis(0), image))
}

impl<T: Copy + Element> PyValues<'_, T> {
    pub fn to_engine(&self) -> PyResult<Values<'_, T>> {
        Ok(match self {
            Self::Value(value) => Values::Same(*value),
            Self::Array(values) => Values::Each(values.as_slice()?),
        })
    }
}

impl PyPerJot<'_> {
    pub fn to_engine(&self) -> PerJot<'_> {
        match self {
            Self::Value(value) => PerJot::Same(*value),
            Self::Array(map) => PerJot::Map(map.as_array()),
        }
    }
}

impl PyImage<'_> {
    pub fn to_engine(&self) -> Image<'_> {
        match self {
            Self::F32(image) => Image::F32(image.as_array()),
            Self::F64(image) => Image::F64(image.as_array()),
        }
    }
}

/// The parameters of an ADMM update, as the tuple (penalty of each image, relaxation).
#[derive(FromPyObject)]
pub struct PyAdmmStep<'py>(PyReadonlyArray1<'py, f64>, f64);

impl PyAdmmStep<'_> {
    /// Return the parameters of each image.
    pub fn to_engine(&self) -> PyResult<Vec<AdmmStep>> {
        let penalties = self.0.as_slice()?;
        let relaxation = self.1;
        let step = |&penalty| AdmmStep {
            penalty,
            relaxation,
        };
        Ok(penalties.iter().map(step).collect())
    }
}

/// Check the length of an array.
pub fn check_length(what: &'static str, expected: usize, received: usize) -> PyResult<()> {
    if expected == received {
        return Ok(());
    }
    let message = format!("{what}: expected length {expected}, got {received}");
    Err(PyValueError::new_err(message))
}
