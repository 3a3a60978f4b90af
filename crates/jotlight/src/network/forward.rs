//! From the sums of the first layer to a picture.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis};
use rayon::prelude::*;

use super::Layer;
use super::lsi::{Padded, block_filter};
use crate::bits::{PackedBits, check_mask};
use crate::error::{Error, Result};

/// The linear part of a first layer, p of equation (11), one plane per filter. `valid` is a packed mask of the jots that count;
/// where some do not, the others stand for them, and a pixel without any becomes NaN.
///
/// # Errors
/// [`Error::Shape`] when bits, mask and the layer's filters `(C, T, K̂, K̂)` do not fit.
pub fn block_sums(
    layer: &Layer,
    bits: &PackedBits<'_>,
    valid: Option<ArrayView2<'_, u8>>,
) -> Result<Array3<f32>> {
    let (_, frames, height, width) = layer.filters.dim();
    if height != width {
        return Err(Error::shape(
            "filters of a first layer",
            "squares of K̂ x K̂ taps",
            (height, width),
        ));
    }
    let (given, rows, columns) = bits.shape();
    if frames != given {
        return Err(Error::shape("frames of the bits", frames, given));
    }
    check_mask(valid, rows, columns)?;
    let pixels = bits.pixels(height)?;
    Ok(block_filter(bits, valid, layer.filters.view(), pixels))
}

/// The network's picture from the sums p of its first layer, `(C, H, W)`: equations (10), (9), (8), and so on for further layers.
///
/// # Errors
/// [`Error::Shape`] when layers, filters and sums do not fit.
pub fn forward(layers: &[Layer], sums: ArrayView3<'_, f32>) -> Result<Array2<f32>> {
    let Some((first, rest)) = layers.split_first() else {
        return Err(Error::range("layers", "at least one", 0));
    };
    if sums.dim().0 != first.channels() || sums.is_empty() {
        return Err(Error::shape(
            "planes of the first layer",
            first.channels(),
            sums.dim(),
        ));
    }
    let mut planes = sums.to_owned();
    for (channel, mut plane) in planes.outer_iter_mut().enumerate() {
        let spline = first.spline(channel);
        plane
            .axis_iter_mut(Axis(0))
            .into_par_iter()
            .for_each(|mut row| row.mapv_inplace(|z| spline.value(z)));
    }
    for layer in rest {
        let (_, inputs, height, width) = layer.filters.dim();
        if inputs != planes.dim().0 {
            return Err(Error::shape(
                "input channels of a layer",
                planes.dim().0,
                inputs,
            ));
        }
        let padded = Padded::new(planes.view(), (height, width));
        let mut outputs = Array3::zeros((layer.channels(), planes.dim().1, planes.dim().2));
        for (channel, out) in outputs.outer_iter_mut().enumerate() {
            let spline = layer.spline(channel);
            let filter = layer.filters.index_axis(Axis(0), channel);
            padded.convolve(filter, |z| spline.value(z), out);
        }
        planes = outputs;
    }
    if planes.dim().0 != 1 {
        return Err(Error::shape(
            "output channels of the last layer",
            1,
            planes.dim().0,
        ));
    }
    Ok(planes.index_axis_move(Axis(0), 0))
}
