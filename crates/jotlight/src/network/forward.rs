//! From the sums of the first layer to a picture.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis};

use super::block::{block_filter, check_block};
use super::lsi::Padded;
use super::{Layer, Real, check_chain};
use crate::bits::{PackedBits, check_mask};
use crate::error::{Error, Result};

/// The linear part of a first layer, p of equation (11), one plane per filter. `valid` is a packed mask of the jots that count;
/// where some do not, the others stand for them, and a pixel without any becomes NaN.
///
/// # Errors
/// [`Error::Shape`] when bits, mask and the layer's filters `(C, T, K̂, K̂)` do not fit.
pub fn block_sums<F: Real>(
    layer: &Layer<F>,
    bits: &PackedBits<'_>,
    valid: Option<ArrayView2<'_, u8>>,
) -> Result<Array3<F>> {
    let pixels = check_block(layer.filters(), bits)?;
    let (_, rows, columns) = bits.shape();
    check_mask(valid, rows, columns)?;
    Ok(block_filter(bits, valid, layer.filters(), pixels))
}

/// The network's picture from the sums p of its first layer, `(C, H, W)`: equations (10), (9), (8), and so on for further layers.
///
/// # Errors
/// [`Error::Shape`] when layers, filters and sums do not fit.
pub fn forward<F: Real>(layers: &[Layer<F>], sums: ArrayView3<'_, F>) -> Result<Array2<F>> {
    check_chain(layers)?;
    if sums.dim().0 != layers[0].splines.len() || sums.is_empty() {
        return Err(Error::shape(
            "planes of the first layer",
            layers[0].splines.len(),
            sums.dim(),
        ));
    }
    let mut planes = sums.as_standard_layout().into_owned();
    layers[0].bend(&mut planes);
    for layer in &layers[1..] {
        let (_, _, height, width) = layer.filters.dim();
        planes = Padded::mirrored(planes.view(), (height, width)).convolve(layer.filters());
        layer.bend(&mut planes);
    }
    Ok(planes.index_axis_move(Axis(0), 0))
}
