//! The sums of a block of frames along a motion.

use ndarray::{ArrayView2, ArrayView3};

use super::count::Count;
use super::lines::BLOCK;
use crate::bits::contiguous;
use crate::error::{Error, Result};

/// The sums of a block of frames along a motion, as [`super::count_shifted`] computes them.
#[derive(Clone, Copy, Debug)]
pub struct Sums<'a, C = i32> {
    /// N, the number of ones of each pixel, `(H, W)`.
    pub ones: ArrayView2<'a, C>,
    /// D, the number of valid bits of each pixel, `(H, W)`.
    pub trials: ArrayView2<'a, C>,
    /// The remainders in rows and columns, `(H, 2, ⌈W/BLOCK⌉)`: their sum over the frames, and
    /// their mean over [`BLOCK`] pixels of a row.
    pub remainders: ArrayView3<'a, f32>,
    /// The number of frames.
    pub frames: usize,
}

/// Check that remainders have the shape of an image, and are finite.
pub(super) fn check_remainders(
    remainders: ArrayView3<'_, f32>,
    size: (usize, usize),
) -> Result<()> {
    let shape = (size.0, 2, size.1.div_ceil(BLOCK));
    if remainders.dim() != shape {
        return Err(Error::shape("remainders", shape, remainders.dim()));
    }
    // Without an early end, the compiler vectorizes the search.
    let is_wrong = |any, value: &f32| any | !value.is_finite();
    if !remainders.fold(false, is_wrong) {
        return Ok(());
    }
    let wrong = remainders.iter().find(|value| !value.is_finite());
    let value = wrong.copied().unwrap_or_default();
    Err(Error::range("remainders", "finite numbers", value))
}

/// Check that the counts have the shape of an image.
pub(super) fn check_shapes<C>(
    ones: ArrayView2<'_, C>,
    trials: ArrayView2<'_, C>,
    size: (usize, usize),
) -> Result<()> {
    for (what, counts) in [("numbers of ones", ones), ("numbers of trials", trials)] {
        if counts.dim() != size {
            return Err(Error::shape(what, size, counts.dim()));
        }
    }
    Ok(())
}

/// Check that the counts have the shape of an image, and are possible.
pub(super) fn check_counts<C: Count>(
    ones: ArrayView2<'_, C>,
    trials: ArrayView2<'_, C>,
    size: (usize, usize),
) -> Result<()> {
    check_shapes(ones, trials, size)?;
    for (ones, trials) in ones.rows().into_iter().zip(trials.rows()) {
        let (ones, trials) = (contiguous(ones), contiguous(trials));
        let is_wrong = |(&ones, &trials): (&C, &C)| !C::are_possible(ones, trials);
        let mut pairs = ones.iter().zip(trials.iter());
        // Without an early end, the compiler vectorizes the search.
        if pairs.clone().fold(false, |any, pair| any | is_wrong(pair)) {
            let wrong = pairs.find(|&pair| is_wrong(pair));
            let received = wrong.map(|pair| format!("{pair:?} (ones, trials)"));
            return Err(Error::range(
                "numbers of ones",
                C::EXPECTED,
                received.unwrap_or_default(),
            ));
        }
    }
    Ok(())
}
