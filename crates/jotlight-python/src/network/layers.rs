//! The conversion of layers to layers of the engine.

use jotlight::network::{Layer, Wiring};
use jotlight::numbers::Real;
use numpy::{Element, PyReadonlyArray2, PyReadonlyArray4};
use pyo3::prelude::*;

use crate::to_python;

/// A layer, as the tuple (filters, coefficients, first knot, knot spacing, wiring). The wiring is
/// the tuple (stride, upsampling, input, skip).
pub type PyLayer<'py, F> = (
    PyReadonlyArray4<'py, F>,
    Option<PyReadonlyArray2<'py, F>>,
    f64,
    f64,
    (usize, usize, Option<usize>, Option<usize>),
);

pub fn to_engine<F: Real + Element>(layer: &PyLayer<'_, F>) -> PyResult<Layer<F>> {
    let (filters, coefficients, start, spacing, wiring) = layer;
    let &(stride, upsampling, input, skip) = wiring;
    let wiring = Wiring {
        stride,
        upsampling,
        input,
        skip,
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

pub fn all_to_engine<F: Real + Element>(layers: &[PyLayer<'_, F>]) -> PyResult<Vec<Layer<F>>> {
    layers.iter().map(to_engine).collect()
}

/// A layer of the engine. It keeps its filters in the order in which the engine's loops read them.
#[pyclass(frozen, name = "Layer")]
pub struct PreparedLayer(pub Layer<f32>);

#[pymethods]
impl PreparedLayer {
    #[new]
    fn new(layer: PyLayer<'_, f32>) -> PyResult<Self> {
        Ok(Self(to_engine(&layer)?))
    }

    /// The number of multiplications of the filters per position of their output.
    #[getter]
    fn multiplications(&self) -> f64 {
        self.0.multiplications()
    }
}

/// Return references to the layers of the engine. Threads can use them without the GIL.
pub fn engine_layers(layers: &[Py<PreparedLayer>]) -> Vec<&Layer<f32>> {
    layers.iter().map(|layer| &layer.get().0).collect()
}
