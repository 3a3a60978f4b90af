//! The forward pass of a network: from counts, bits, or sums to an image.

use jotlight::bits::PackedBits;
use jotlight::error::Result;
use jotlight::network::{self, Layer};
use ndarray::{Array2, Array3, ArrayViewMut2, Axis};
use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArray4,
};
use pyo3::prelude::*;
use rayon::prelude::*;

use super::layers::{PreparedLayer, engine_layers};
use crate::run;

/// The maximum number of pixels of images that are evaluated at the same time. Larger images have
/// several tiles, which run in parallel, and more images at once would not fit into the caches.
const MAX_PIXELS_IN_PARALLEL: usize = 1 << 12;

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

/// Return the images `(N, H, W)` that the network computes from the sums p of its first layer,
/// `(N, C, H, W)`.
#[pyfunction]
#[pyo3(signature = (layers, sums, threads))]
pub fn forward<'py>(
    py: Python<'py>,
    layers: Vec<Py<PreparedLayer>>,
    sums: PyReadonlyArray4<'_, f32>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let sums = sums.as_array();
    compute_images(py, &layers, threads, sums.dim().0, |layers, image| {
        network::forward(layers, sums.index_axis(Axis(0), image))
    })
}

/// Return the images `(N, H, W)` that the network computes from counts.
#[pyfunction]
#[pyo3(signature = (layers, counts, sums, threads))]
pub fn forward_counts<'py>(
    py: Python<'py>,
    layers: Vec<Py<PreparedLayer>>,
    counts: PyReadonlyArray3<'_, i32>,
    sums: PyReadonlyArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let (counts, sums) = (counts.as_array(), sums.as_array());
    compute_images(py, &layers, threads, counts.dim().0, |layers, image| {
        network::forward_counts(layers, counts.index_axis(Axis(0), image), sums)
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
    let (packed, layers) = (packed.as_array(), engine_layers(&layers));
    let image = run(py, threads, || {
        network::forward_bits(&layers, &PackedBits::new(packed, width)?)
    })?;
    Ok(image.into_pyarray(py))
}

/// Run `evaluate` without the GIL for each of `number` images, and return all of them. Small images
/// are evaluated in parallel.
fn compute_images<'py>(
    py: Python<'py>,
    layers: &[Py<PreparedLayer>],
    threads: Option<isize>,
    number: usize,
    evaluate: impl Fn(&[&Layer<f32>], usize) -> Result<Array2<f32>> + Send + Sync,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let layers = engine_layers(layers);
    let images = run(py, threads, || {
        let first = evaluate(&layers, 0)?.insert_axis(Axis(0));
        if number == 1 {
            return Ok(first);
        }
        let (_, height, width) = first.dim();
        let mut images = Array3::zeros((number, height, width));
        let write = |(image, mut place): (usize, ArrayViewMut2<'_, f32>)| {
            place.assign(&evaluate(&layers, image)?);
            Ok(())
        };
        let places = images.axis_iter_mut(Axis(0));
        if height * width <= MAX_PIXELS_IN_PARALLEL {
            let places = places.into_par_iter().enumerate();
            places.skip(1).try_for_each(write)?;
        } else {
            places.enumerate().skip(1).try_for_each(write)?;
        }
        images
            .index_axis_mut(Axis(0), 0)
            .assign(&first.index_axis(Axis(0), 0));
        Ok(images)
    })?;
    Ok(images.into_pyarray(py))
}
