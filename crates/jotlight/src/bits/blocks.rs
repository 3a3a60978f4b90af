//! Counts of the ones of blocks: parts of consecutive frames of the same length.

use ndarray::{Array2, ArrayViewMut2, ArrayViewMut3, Axis};
use rayon::prelude::*;

use super::{PackedBits, add_block_counts};
use crate::error::{Error, Result};

/// The blocks to which frames belong.
#[derive(Clone, Copy, Debug)]
pub struct Blocks {
    /// The number of frames of the first block that come before the bits.
    pub before: usize,
    /// The number of frames of a block.
    pub length: usize,
    /// The number that a one counts, such as 2^n for the digit n of binary numbers.
    pub weight: i32,
}

/// Add the number of ones of each square of jots in each block of frames to `counts` `(n, h, w)`.
///
/// Squares have `side` × `side` jots.
///
/// # Errors
/// [`Error::Shape`] if the shapes do not match. [`Error::Range`] if a length, the weight, or the
/// side is less than 1, the side does not divide the height and the width, the frames do not belong
/// to the blocks, or a count could exceed the `i32`. After the last error, the counts are
/// incomplete.
pub fn add_counts_of_blocks(
    bits: &PackedBits<'_>,
    side: usize,
    blocks: Blocks,
    mut counts: ArrayViewMut3<'_, i32>,
) -> Result<()> {
    let Blocks {
        before,
        length,
        weight,
    } = blocks;
    if length == 0 || weight < 1 {
        let received = format!("a length of {length} and a weight of {weight}");
        return Err(Error::range("blocks", "at least 1", received));
    }
    let (height, width) = bits.pixel_shape(side)?;
    let (number, ..) = counts.dim();
    if counts.dim() != (number, height, width) {
        return Err(Error::shape(
            "counts",
            (number, height, width),
            counts.dim(),
        ));
    }
    let frames = bits.shape().0;
    let end = before.checked_add(frames);
    if end.is_none_or(|end| end > number.saturating_mul(length)) {
        let expected = format!("at most {number} blocks of {length}");
        let received = format!("{frames} after {before}");
        return Err(Error::range("frames", expected, received));
    }
    counts
        .axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .try_for_each(|(index, counts)| {
            let place = |frame: usize| frame.saturating_sub(before).min(frames);
            let start = index.saturating_mul(length);
            let part = place(start)..place(start.saturating_add(length));
            if part.is_empty() {
                return Ok(());
            }
            add_weighted(&bits.frames(part), side, weight, counts)
        })
}

fn add_weighted(
    bits: &PackedBits<'_>,
    side: usize,
    weight: i32,
    mut counts: ArrayViewMut2<'_, i32>,
) -> Result<()> {
    if weight == 1 {
        return add_block_counts(bits, side, None, counts);
    }
    let mut ones = Array2::zeros(counts.dim());
    add_block_counts(bits, side, None, ones.view_mut())?;
    for (count, &ones) in counts.iter_mut().zip(&ones) {
        let sum = weight.checked_mul(ones);
        *count = sum.and_then(|sum| count.checked_add(sum)).ok_or_else(|| {
            let received = format!("a count of {count} and {weight} times {ones}");
            Error::range("counts", "sums of less than 2^31", received)
        })?;
    }
    Ok(())
}
