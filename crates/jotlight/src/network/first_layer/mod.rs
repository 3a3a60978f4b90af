//! The first layer, equation (11): the sum p = Σ h1·b over the jots and frames of each pixel.
//!
//! `bit_tables` filters bits, `masked` filters bits with dead jots, and `count_table` maps counts
//! to the output of the layer. `training_data` does both for training, and computes derivatives.

pub(crate) mod bit_tables;
pub(crate) mod count_table;
pub(crate) mod masked;
pub(crate) mod training_data;

use ndarray::ArrayView4;

use crate::bits::PackedBits;
use crate::error::{Error, Result};
use crate::numbers::Real;

/// Return the number of rows and of columns of pixels. Check that the filters have the shape
/// `(C, T, K̂, K̂)` for the frames of the bits.
pub(crate) fn pixel_grid<F: Real>(
    filters: ArrayView4<'_, F>,
    bits: &PackedBits<'_>,
) -> Result<(usize, usize)> {
    let (_, frames, height, width) = filters.dim();
    if height != width {
        let expected = format_args!("K̂ x K̂ taps");
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
