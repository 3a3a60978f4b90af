//! Sums of the counts of several blocks of frames.

use ndarray::{ArrayView1, ArrayView2, ArrayViewMut1, ArrayViewMut2, Axis};
use rayon::prelude::*;

use crate::bits::{contiguous, packed_width};
use crate::cpu::levels;
use crate::error::{Error, Result, check_shape};

/// The number of rows that one task adds.
const ROWS_PER_TASK: usize = 32;

/// Add images of counts `(H, W)` to `out`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if a sum exceeds the
/// `i32`. After the latter error, the sums are incomplete.
pub fn add_counts(parts: &[ArrayView2<'_, i32>], mut out: ArrayViewMut2<'_, i32>) -> Result<()> {
    for part in parts {
        check_shape("counts", out.dim(), part.dim())?;
    }
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .with_min_len(ROWS_PER_TASK)
        .enumerate()
        .try_for_each(|(row, mut out)| {
            let mut signs = 0;
            for part in parts {
                add(&contiguous(part.row(row)), &mut out, &mut signs);
            }
            check_sums(signs)
        })
}

/// The counts of a block of frames, and the sums to which those of some pixels are added.
#[derive(Debug)]
pub struct Accepted<'a> {
    /// The ones and the trials of the block, `(H, W)`.
    pub counts: [ArrayView2<'a, i32>; 2],
    /// The sums, `(H, W)`.
    pub sums: [ArrayViewMut2<'a, i32>; 2],
    /// The packed pixels that are added, `(H, ⌈W/8⌉)`.
    pub mask: ArrayViewMut2<'a, u8>,
}

/// Add the counts of the pixels whose value in `test` `(H, W)` is below a limit to the sums, and
/// write these pixels into the mask.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if a sum exceeds the
/// `i32`. After the latter error, the sums are incomplete.
pub fn add_accepted(test: ArrayView2<'_, f32>, limit: f32, block: Accepted<'_>) -> Result<()> {
    let Accepted {
        counts,
        sums: [mut ones, mut trials],
        mut mask,
    } = block;
    let size = test.dim();
    for shape in [counts[0].dim(), counts[1].dim(), ones.dim(), trials.dim()] {
        check_shape("counts", size, shape)?;
    }
    check_shape("packed mask", (size.0, packed_width(size.1)), mask.dim())?;
    let width = mask.ncols();
    ones.axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(trials.axis_iter_mut(Axis(0)))
        .zip(mask.axis_iter_mut(Axis(0)))
        .with_min_len(ROWS_PER_TASK)
        .enumerate()
        .try_for_each(|(row, ((ones, trials), mut mask))| {
            let mut signs = 0;
            let counts = counts.map(|counts| counts.index_axis_move(Axis(0), row));
            let mut bytes = vec![0; width];
            accept_row(
                &contiguous(test.row(row)),
                limit,
                counts,
                [ones, trials],
                &mut bytes,
                &mut signs,
            );
            mask.iter_mut()
                .zip(&bytes)
                .for_each(|(byte, &value)| *byte = value);
            check_sums(signs)
        })
}

/// Check the signs of sums, which are negative if a sum exceeds the `i32`.
pub(super) fn check_sums(signs: i32) -> Result<()> {
    if signs < 0 {
        let expected = "sums of less than 2^31; add fewer of them";
        return Err(Error::range("counts", expected, "a larger sum"));
    }
    Ok(())
}

levels! {
    /// Add a row of counts. `signs` become negative if a sum exceeds the `i32`.
    pub(super) fn add(
        counts: &[i32], sums: &mut ArrayViewMut1<'_, i32>, signs: &mut i32,
    ) = add_inlined;
    /// Add the counts of a row whose value in `test` is below a limit, and pack these pixels.
    /// `signs` become negative if a sum exceeds the `i32`.
    pub(super) fn accept_row(
        test: &[f32],
        limit: f32,
        counts: [ArrayView1<'_, i32>; 2],
        sums: [ArrayViewMut1<'_, i32>; 2],
        mask: &mut [u8],
        signs: &mut i32,
    ) = accept_row_inlined;
}

#[inline(always)]
fn add_inlined(counts: &[i32], sums: &mut ArrayViewMut1<'_, i32>, signs: &mut i32) {
    add_terms(counts.iter().copied(), sums, signs);
}

/// Add terms to sums. The compiler vectorizes this loop, which does not end at a large sum.
#[inline(always)]
fn add_terms(terms: impl Iterator<Item = i32>, sums: &mut ArrayViewMut1<'_, i32>, signs: &mut i32) {
    let mut all = *signs;
    let add = |(sum, term): (&mut i32, i32)| {
        let total = sum.wrapping_add(term);
        // A sum that wraps has another sign than both of its terms.
        all |= (total ^ *sum) & (total ^ term);
        *sum = total;
    };
    match sums.as_slice_mut() {
        Some(sums) => sums.iter_mut().zip(terms).for_each(add),
        None => sums.iter_mut().zip(terms).for_each(add),
    }
    *signs = all;
}

#[inline(always)]
fn accept_row_inlined(
    test: &[f32],
    limit: f32,
    counts: [ArrayView1<'_, i32>; 2],
    sums: [ArrayViewMut1<'_, i32>; 2],
    mask: &mut [u8],
    signs: &mut i32,
) {
    for (counts, mut sums) in counts.into_iter().zip(sums) {
        let counts = contiguous(counts);
        let terms = test.iter().zip(counts.iter());
        let terms = terms.map(|(&value, &count)| if value < limit { count } else { 0 });
        add_terms(terms, &mut sums, signs);
    }
    let (tests, rest) = test.as_chunks::<8>();
    for (byte, test) in mask.iter_mut().zip(tests) {
        *byte = pack(test, limit);
    }
    if !rest.is_empty() {
        mask[tests.len()] = pack(rest, limit);
    }
}

/// Return the bits of values that are below a limit, the first one as the highest bit.
#[inline(always)]
fn pack(test: &[f32], limit: f32) -> u8 {
    let bits = test.iter().enumerate();
    bits.fold(0, |byte, (bit, &value)| {
        byte | u8::from(value < limit) << (7 - bit)
    })
}
