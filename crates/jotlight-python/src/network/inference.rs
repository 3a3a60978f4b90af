//! The forward pass of a network: from counts, bits, or sums to images in arrays of the caller.

use jotlight::bits::PackedBits;
use jotlight::error::Result;
use jotlight::network::{self, Layer};
use ndarray::{ArrayViewMut, Axis, Dimension};
use numpy::{
    IntoPyArray, PyArray3, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray2, PyReadwriteArray3,
};
use pyo3::prelude::*;
use rayon::prelude::*;

use super::layers::{PreparedLayer, engine_layers};
use crate::arguments::check_length;
use crate::run;

/// The maximum number of pixels of images that are evaluated at the same time. Larger images have
/// several tiles, which run in parallel, and more images at once would not fit into the caches.
const MAX_PIXELS_IN_PARALLEL: usize = 1 << 12;

/// Return the sums p of the first layer from the bits of each image, whose dead jots are the same.
#[pyfunction]
#[pyo3(signature = (layer, packed, width, valid, threads))]
pub fn masked_sums<'py>(
    py: Python<'py>,
    layer: Py<PreparedLayer>,
    packed: Vec<PyReadonlyArray3<'_, u8>>,
    width: usize,
    valid: PyReadonlyArray2<'_, u8>,
    threads: Option<isize>,
) -> PyResult<Vec<Bound<'py, PyArray3<f32>>>> {
    let packed: Vec<_> = packed.iter().map(PyReadonlyArray3::as_array).collect();
    let valid = valid.as_array();
    let sums: Vec<_> = run(py, threads, || {
        packed
            .into_par_iter()
            .map(|packed| {
                network::masked_sums(&layer.get().0, &PackedBits::new(packed, width)?, valid)
            })
            .collect()
    })?;
    Ok(sums.into_iter().map(|sums| sums.into_pyarray(py)).collect())
}

/// Write the planes that the network computes from the sums p of its first layer, `(C, H, W)` for
/// each image, into `out`, `(1, H, W)` for gray images. Images may differ in size.
#[pyfunction]
#[pyo3(signature = (layers, sums, out, threads))]
pub fn forward(
    py: Python<'_>,
    layers: Vec<Py<PreparedLayer>>,
    sums: Vec<PyReadonlyArray3<'_, f32>>,
    mut out: Vec<PyReadwriteArray3<'_, f32>>,
    threads: Option<isize>,
) -> PyResult<()> {
    let sums: Vec<_> = sums.iter().map(PyReadonlyArray3::as_array).collect();
    let out = out.iter_mut().map(|out| out.as_array_mut()).collect();
    write_images(py, &layers, threads, &sums, out, |layers, sums, out| {
        network::forward_planes(layers, sums, out)
    })
}

/// Write the images that the network computes from the counts `(N, H, W)` into `out`.
#[pyfunction]
#[pyo3(signature = (layers, counts, sums, out, threads))]
pub fn forward_counts(
    py: Python<'_>,
    layers: Vec<Py<PreparedLayer>>,
    counts: PyReadonlyArray3<'_, i32>,
    sums: PyReadonlyArray2<'_, f32>,
    mut out: Vec<PyReadwriteArray2<'_, f32>>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (counts, sums) = (counts.as_array(), sums.as_array());
    let counts: Vec<_> = counts.axis_iter(Axis(0)).collect();
    let out = out.iter_mut().map(|out| out.as_array_mut()).collect();
    write_images(py, &layers, threads, &counts, out, |layers, counts, out| {
        network::forward_counts(layers, counts, sums, out)
    })
}

/// Write the images that a tied network computes from the bits of each into `out`.
#[pyfunction]
#[pyo3(signature = (layers, packed, width, oversampling, sums, out, threads))]
#[allow(clippy::too_many_arguments)]
pub fn forward_tied_bits(
    py: Python<'_>,
    layers: Vec<Py<PreparedLayer>>,
    packed: Vec<PyReadonlyArray3<'_, u8>>,
    width: usize,
    oversampling: usize,
    sums: PyReadonlyArray2<'_, f32>,
    mut out: Vec<PyReadwriteArray2<'_, f32>>,
    threads: Option<isize>,
) -> PyResult<()> {
    let packed: Vec<_> = packed.iter().map(PyReadonlyArray3::as_array).collect();
    let sums = sums.as_array();
    let out = out.iter_mut().map(|out| out.as_array_mut()).collect();
    write_images(py, &layers, threads, &packed, out, |layers, packed, out| {
        let bits = PackedBits::new(packed, width)?;
        network::forward_tied_bits(layers, &bits, oversampling, sums, out)
    })
}

/// Write the images that the network computes from the bits of each into `out`.
#[pyfunction]
#[pyo3(signature = (layers, packed, width, out, threads))]
pub fn forward_bits(
    py: Python<'_>,
    layers: Vec<Py<PreparedLayer>>,
    packed: Vec<PyReadonlyArray3<'_, u8>>,
    width: usize,
    mut out: Vec<PyReadwriteArray2<'_, f32>>,
    threads: Option<isize>,
) -> PyResult<()> {
    let packed: Vec<_> = packed.iter().map(PyReadonlyArray3::as_array).collect();
    let out = out.iter_mut().map(|out| out.as_array_mut()).collect();
    write_images(py, &layers, threads, &packed, out, |layers, packed, out| {
        network::forward_bits(layers, &PackedBits::new(packed, width)?, out)
    })
}

/// Run `evaluate` without the GIL for each input, which writes an image. Small images are evaluated
/// in parallel, the others one after another, because each of them runs on all threads.
fn write_images<Input: Copy + Send + Sync, D: Dimension>(
    py: Python<'_>,
    layers: &[Py<PreparedLayer>],
    threads: Option<isize>,
    inputs: &[Input],
    out: Vec<ArrayViewMut<'_, f32, D>>,
    evaluate: impl Fn(&[&Layer<f32>], Input, ArrayViewMut<'_, f32, D>) -> Result<()> + Send + Sync,
) -> PyResult<()> {
    check_length("out", inputs.len(), out.len())?;
    let layers = engine_layers(layers);
    run(py, threads, || {
        let places = inputs.iter().zip(out);
        let (small, large): (Vec<_>, Vec<_>) =
            places.partition(|(_, image)| image.len() <= MAX_PIXELS_IN_PARALLEL);
        let write =
            |(input, out): (&Input, ArrayViewMut<'_, f32, D>)| evaluate(&layers, *input, out);
        large.into_iter().try_for_each(write)?;
        small.into_par_iter().try_for_each(write)
    })
}
