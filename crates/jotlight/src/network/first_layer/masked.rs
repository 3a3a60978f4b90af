//! The filters of the first layer, equation (11), for bits with dead jots.

use ndarray::{Array3, ArrayView2, ArrayView4, Axis};
use rayon::prelude::*;

use crate::bits::{PackedBits, bit_field, mask_row};
use crate::error::Result;
use crate::numbers::Real;
use crate::{interrupt, memory};

/// Return p of equation (11), one plane per filter.
///
/// `valid` is a packed mask of the jots that are not dead. The mean of the valid bits of a pixel
/// replaces the bits of its dead jots. A pixel without a valid jot is NaN.
pub(crate) fn filter_masked_bits<F: Real>(
    bits: &PackedBits<'_>,
    valid: ArrayView2<'_, u8>,
    filters: ArrayView4<'_, F>,
    (height, width): (usize, usize),
) -> Result<Array3<F>> {
    let mut planes = memory::zeros("sums", (filters.dim().0, height, width))?;
    if planes.is_empty() {
        return Ok(planes);
    }
    for (filter, mut plane) in filters.outer_iter().zip(planes.outer_iter_mut()) {
        let side = filter.dim().1;
        let rows = plane.axis_iter_mut(Axis(0)).into_par_iter().enumerate();
        rows.for_each(|(row, mut out)| {
            let mut blocks = vec![BlockSums::<F>::default(); width];
            for (frame, taps) in filter.outer_iter().enumerate() {
                for (jot_row, taps) in taps.outer_iter().enumerate() {
                    if interrupt::is_requested() {
                        return;
                    }
                    let jots = bits.row(frame, row * side + jot_row);
                    let valid = mask_row(valid, row * side + jot_row);
                    for (pixel, (out, block)) in out.iter_mut().zip(&mut blocks).enumerate() {
                        for (column, &tap) in taps.iter().enumerate() {
                            let jot = pixel * taps.len() + column;
                            if bit_field(&valid, jot, 1) == 1 {
                                let bit = F::from_index(bit_field(&jots, jot, 1) as usize);
                                *out += tap * bit;
                                block.ones += bit;
                                block.valid_jots += F::one();
                            } else {
                                block.dead_taps += tap;
                            }
                        }
                    }
                }
            }
            for (out, block) in out.iter_mut().zip(blocks) {
                *out += block.dead_taps * (block.ones / block.valid_jots);
            }
        });
    }
    Ok(planes)
}

/// The sums over the bits of a pixel that determine the contribution of its dead jots.
#[derive(Clone, Default)]
struct BlockSums<F> {
    /// The sum of the taps at dead jots.
    dead_taps: F,
    ones: F,
    valid_jots: F,
}
