//! Sums of the counts of several blocks of frames.

use ndarray::{ArrayView2, ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::filter::values;
use crate::bits::packed_width;
use crate::cpu::levels;
use crate::error::{Error, Result};

/// The number of rows that one task adds.
const ROWS_PER_TASK: usize = 32;

/// Add images of counts `(H, W)` to `out`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match.
pub fn add_counts(parts: &[ArrayView2<'_, i32>], mut out: ArrayViewMut2<'_, i32>) -> Result<()> {
    for part in parts {
        check_shape("counts", out.dim(), part.dim())?;
    }
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .with_min_len(ROWS_PER_TASK)
        .enumerate()
        .for_each(|(row, mut out)| {
            for part in parts {
                add(&values(part.row(row)), &mut out);
            }
        });
    Ok(())
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
/// [`Error::Shape`] if the shapes of the arrays do not match.
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
    ones.axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(trials.axis_iter_mut(Axis(0)))
        .zip(mask.axis_iter_mut(Axis(0)))
        .with_min_len(ROWS_PER_TASK)
        .enumerate()
        .for_each(|(row, ((mut ones, mut trials), mut mask))| {
            let test = values(test.row(row));
            for (counts, sums) in counts.iter().zip([&mut ones, &mut trials]) {
                add_below(&test, limit, &values(counts.row(row)), sums);
            }
            for (byte, test) in mask.iter_mut().zip(test.chunks(8)) {
                *byte = test.iter().enumerate().fold(0, |byte, (bit, &value)| {
                    byte | u8::from(value < limit) << (7 - bit)
                });
            }
        });
    Ok(())
}

fn check_shape(what: &'static str, expected: (usize, usize), got: (usize, usize)) -> Result<()> {
    if got == expected {
        Ok(())
    } else {
        Err(Error::shape(what, expected, got))
    }
}

levels! {
    /// Add a row of counts.
    fn add(counts: &[i32], sums: &mut ndarray::ArrayViewMut1<'_, i32>) = add_inlined;
    /// Add the counts whose value in `test` is below a limit.
    fn add_below(
        test: &[f32], limit: f32, counts: &[i32], sums: &mut ndarray::ArrayViewMut1<'_, i32>,
    ) = add_below_inlined;
}

#[inline(always)]
fn add_inlined(counts: &[i32], sums: &mut ndarray::ArrayViewMut1<'_, i32>) {
    match sums.as_slice_mut() {
        Some(sums) => sums.iter_mut().zip(counts).for_each(|(sum, n)| *sum += n),
        None => sums.iter_mut().zip(counts).for_each(|(sum, n)| *sum += n),
    }
}

#[inline(always)]
fn add_below_inlined(
    test: &[f32],
    limit: f32,
    counts: &[i32],
    sums: &mut ndarray::ArrayViewMut1<'_, i32>,
) {
    let terms = test.iter().zip(counts);
    let terms = terms.map(|(&value, &count)| if value < limit { count } else { 0 });
    match sums.as_slice_mut() {
        Some(sums) => sums.iter_mut().zip(terms).for_each(|(sum, n)| *sum += n),
        None => sums.iter_mut().zip(terms).for_each(|(sum, n)| *sum += n),
    }
}
