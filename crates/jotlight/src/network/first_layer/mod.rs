//! The first layer, equation (11): p = Σ h1·b over each pixel's block of jots and frames.

pub(crate) mod bit_tables;
pub(crate) mod count_table;
pub(crate) mod masked;
pub(crate) mod training_data;

use ndarray::ArrayView4;

use crate::bits::PackedBits;
use crate::error::{Error, Result};
use crate::numbers::Real;

/// Return rows and columns of pixels, after a check that filters `(C, T, K̂, K̂)` fit the bits.
pub(crate) fn pixel_grid<F: Real>(
    filters: ArrayView4<'_, F>,
    bits: &PackedBits<'_>,
) -> Result<(usize, usize)> {
    let (_, frames, height, width) = filters.dim();
    if height != width {
        let expected = "squares of K̂ x K̂ taps";
        return Err(Error::shape(
            "filters of a first layer",
            expected,
            (height, width),
        ));
    }
    if frames != bits.shape().0 {
        return Err(Error::shape("frames of the bits", frames, bits.shape().0));
    }
    bits.pixel_shape(height)
}
