//! The forward pass of layers: from sums to images in arrays of the caller.

use jotlight::network::{Compiled, write_images};
use numpy::{PyReadonlyArray3, PyReadwriteArray3};
use pyo3::prelude::*;

use super::layers::{PreparedLayer, engine_layers};
use crate::run;

/// Write the planes that the network computes from the sums p of its first layer, `(C, H, W)` for
/// each image, into `out`, `(1, H, W)` for gray images. Images may differ in size.
#[pyfunction]
pub fn forward(
    py: Python<'_>,
    layers: Vec<Py<PreparedLayer>>,
    sums: Vec<PyReadonlyArray3<'_, f32>>,
    mut out: Vec<PyReadwriteArray3<'_, f32>>,
    threads: Option<isize>,
) -> PyResult<()> {
    let sums: Vec<_> = sums.iter().map(PyReadonlyArray3::as_array).collect();
    let out: Vec<_> = out.iter_mut().map(|out| out.as_array_mut()).collect();
    let layers = engine_layers(&layers);
    run(py, threads, || {
        write_images(sums, out, |sums, out| {
            f32::forward_planes(&layers, sums, out)
        })
    })
}
