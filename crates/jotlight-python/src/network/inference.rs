//! The forward pass of a network: from counts, bits, or sums to an image.

use jotlight::bits::PackedBits;
use jotlight::error::Result;
use jotlight::network::{self, Layer};
use ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use super::layers::{PreparedLayer, engine_layers};
use crate::run;

/// Return the sums p of the first layer from bits with dead jots.
#[pyfunction]
#[pyo3(signature = (layer, packed, width, valid, threads))]
pub fn masked_sums<'py>(
    py: Python<'py>,
    layer: Py<PreparedLayer>,
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

/// Return the image that the network computes from the sums p of its first layer.
#[pyfunction]
#[pyo3(signature = (layers, sums, threads))]
pub fn forward<'py>(
    py: Python<'py>,
    layers: Vec<Py<PreparedLayer>>,
    sums: PyReadonlyArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let sums = sums.as_array();
    compute_image(py, &layers, threads, |layers| {
        network::forward(layers, sums)
    })
}

/// Return the image that the network computes from counts.
#[pyfunction]
#[pyo3(signature = (layers, counts, sums, threads))]
pub fn forward_counts<'py>(
    py: Python<'py>,
    layers: Vec<Py<PreparedLayer>>,
    counts: PyReadonlyArray2<'_, i32>,
    sums: PyReadonlyArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (counts, sums) = (counts.as_array(), sums.as_array());
    compute_image(py, &layers, threads, |layers| {
        network::forward_counts(layers, counts, sums)
    })
}

/// Return the image that the network computes from bits.
#[pyfunction]
#[pyo3(signature = (layers, packed, width, threads))]
pub fn forward_bits<'py>(
    py: Python<'py>,
    layers: Vec<Py<PreparedLayer>>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let packed = packed.as_array();
    compute_image(py, &layers, threads, |layers| {
        network::forward_bits(layers, &PackedBits::new(packed, width)?)
    })
}

/// Run `evaluate` without the GIL, and return the image as an array.
fn compute_image<'py>(
    py: Python<'py>,
    layers: &[Py<PreparedLayer>],
    threads: Option<isize>,
    evaluate: impl FnOnce(&[&Layer<f32>]) -> Result<Array2<f32>> + Send,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let layers = engine_layers(layers);
    let image = run(py, threads, || evaluate(&layers))?;
    Ok(image.into_pyarray(py))
}
