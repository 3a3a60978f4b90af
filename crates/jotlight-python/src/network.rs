use jotlight::bits::PackedBits;
use jotlight::network::{self, Layer};
use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArray4,
};
use pyo3::prelude::*;

use crate::{run, to_python};

/// (filters, coefficients, first knot, knot spacing).
type PyLayer<'py> = (
    PyReadonlyArray4<'py, f32>,
    PyReadonlyArray2<'py, f32>,
    f32,
    f32,
);

fn to_engine((filters, coefficients, start, spacing): &PyLayer<'_>) -> PyResult<Layer> {
    Layer::new(
        filters.as_array().to_owned(),
        coefficients.as_array().to_owned(),
        *start,
        *spacing,
    )
    .map_err(to_python)
}

#[pyfunction]
#[pyo3(signature = (layer, packed, width, valid, threads))]
pub fn block_sums<'py>(
    py: Python<'py>,
    layer: PyLayer<'py>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    valid: Option<PyReadonlyArray2<'_, u8>>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (layer, packed) = (to_engine(&layer)?, packed.as_array());
    let valid = valid.as_ref().map(|valid| valid.as_array());
    let sums = run(py, threads, || {
        network::block_sums(&layer, &PackedBits::new(packed, width)?, valid)
    })?;
    Ok(sums.into_pyarray(py))
}

#[pyfunction]
#[pyo3(signature = (layers, sums, threads))]
pub fn forward<'py>(
    py: Python<'py>,
    layers: Vec<PyLayer<'py>>,
    sums: PyReadonlyArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let layers: Vec<Layer> = layers.iter().map(to_engine).collect::<PyResult<_>>()?;
    let sums = sums.as_array();
    let picture = run(py, threads, || network::forward(&layers, sums))?;
    Ok(picture.into_pyarray(py))
}
