//! The forward pass of a network: from counts, bits, or sums to images.

use jotlight::bits::PackedBits;
use jotlight::error::Result;
use jotlight::network::{self, Layer};
use ndarray::{Array2, ArrayView2, ArrayView3, Axis};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;

use super::layers::{PreparedLayer, engine_layers};
use crate::run;

/// The maximum number of pixels of images that are evaluated at the same time. Larger images have
/// several tiles, which run in parallel, and more images at once would not fit into the caches.
const MAX_PIXELS_IN_PARALLEL: usize = 1 << 12;

/// One array `(H, W)` for each image.
type Images<'py> = Vec<Bound<'py, PyArray2<f32>>>;

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

/// Return the images that the network computes from the sums p of its first layer, `(C, H, W)` for
/// each image. Images may differ in size.
#[pyfunction]
#[pyo3(signature = (layers, sums, threads))]
pub fn forward<'py>(
    py: Python<'py>,
    layers: Vec<Py<PreparedLayer>>,
    sums: Vec<PyReadonlyArray3<'_, f32>>,
    threads: Option<isize>,
) -> PyResult<Images<'py>> {
    let sums: Vec<_> = sums.iter().map(PyReadonlyArray3::as_array).collect();
    let pixels = |sums: ArrayView3<'_, f32>| sums.dim().1 * sums.dim().2;
    compute_images(py, &layers, threads, &sums, pixels, |layers, sums| {
        network::forward(layers, sums)
    })
}

/// Return the images that the network computes from the counts `(N, H, W)`.
#[pyfunction]
#[pyo3(signature = (layers, counts, sums, threads))]
pub fn forward_counts<'py>(
    py: Python<'py>,
    layers: Vec<Py<PreparedLayer>>,
    counts: PyReadonlyArray3<'_, i32>,
    sums: PyReadonlyArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<Images<'py>> {
    let (counts, sums) = (counts.as_array(), sums.as_array());
    let counts: Vec<_> = counts.axis_iter(Axis(0)).collect();
    let pixels = |counts: ArrayView2<'_, i32>| counts.len();
    compute_images(py, &layers, threads, &counts, pixels, |layers, counts| {
        network::forward_counts(layers, counts, sums)
    })
}

/// Return the images that the network computes from the bits of each.
#[pyfunction]
#[pyo3(signature = (layers, packed, width, threads))]
pub fn forward_bits<'py>(
    py: Python<'py>,
    layers: Vec<Py<PreparedLayer>>,
    packed: Vec<PyReadonlyArray3<'_, u8>>,
    width: usize,
    threads: Option<isize>,
) -> PyResult<Images<'py>> {
    let packed: Vec<_> = packed.iter().map(PyReadonlyArray3::as_array).collect();
    let first = layers.first().map(|layer| layer.get().0.filters().dim());
    let jots_per_pixel = first.map_or(1, |(_, _, rows, columns)| (rows * columns).max(1));
    let pixels = |packed: ArrayView3<'_, u8>| packed.dim().1 * width / jots_per_pixel;
    compute_images(py, &layers, threads, &packed, pixels, |layers, packed| {
        network::forward_bits(layers, &PackedBits::new(packed, width)?)
    })
}

/// Run `evaluate` without the GIL for each input, and return the images. Inputs of few pixels are
/// evaluated in parallel, the others one after another, because each of them runs on all threads.
fn compute_images<'py, Input: Copy + Send + Sync>(
    py: Python<'py>,
    layers: &[Py<PreparedLayer>],
    threads: Option<isize>,
    inputs: &[Input],
    pixels: impl Fn(Input) -> usize + Send + Sync,
    evaluate: impl Fn(&[&Layer<f32>], Input) -> Result<Array2<f32>> + Send + Sync,
) -> PyResult<Images<'py>> {
    let layers = engine_layers(layers);
    let images = run(py, threads, || {
        let mut images = vec![Array2::zeros((0, 0)); inputs.len()];
        let places = inputs.iter().zip(&mut images);
        let (small, large): (Vec<_>, Vec<_>) =
            places.partition(|(input, _)| pixels(**input) <= MAX_PIXELS_IN_PARALLEL);
        let write = |(input, image): (&Input, &mut Array2<f32>)| {
            *image = evaluate(&layers, *input)?;
            Ok(())
        };
        large.into_iter().try_for_each(write)?;
        small.into_par_iter().try_for_each(write)?;
        Ok(images)
    })?;
    let images = images.into_iter().map(|image| image.into_pyarray(py));
    Ok(images.collect())
}
