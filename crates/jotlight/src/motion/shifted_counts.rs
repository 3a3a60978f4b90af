//! Counts of the ones along a motion.

use std::borrow::Cow;

use ndarray::parallel::prelude::*;
use ndarray::{ArrayView1, ArrayView2, ArrayViewMut2, ArrayViewMut3, Axis, s};

pub use super::row::BLOCK;

use super::field::Displacements;
use super::row_counter::{Input, RowCounter};
use crate::bits::{FRAMES_PER_GROUP, PackedBits, check_mask};
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// The number of rows that one task counts. Its counters fit in the cache.
const ROWS_PER_TASK: usize = 16;

/// The sums along a motion, to which [`add_shifted_counts`] adds.
#[derive(Debug)]
pub struct ShiftedCounts<'a> {
    /// The number of ones of each pixel, `(H, W)`.
    pub ones: ArrayViewMut2<'a, i32>,
    /// The number of valid bits of each pixel, `(H, W)`.
    pub trials: ArrayViewMut2<'a, i32>,
    /// The remainders, in rows and columns: their sum over the frames, and their mean over each
    /// [`BLOCK`] of pixels in a row, `(H, 2, ⌈W/BLOCK⌉)`.
    pub remainders: ArrayViewMut3<'a, f32>,
}

/// Count the ones of frames whose pixels are displaced, and add them to `sums`.
///
/// `times[t]` is the time of frame t between the first (0) and the last field (1) of the
/// displacements. Bits that come from outside the frame, or whose bit in the packed mask `valid`
/// `(H, ⌈W/8⌉)` is 0, are no trials.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if a time is not in
/// \[-1, 2\], or a count could exceed the `i32`.
pub fn add_shifted_counts(
    bits: &PackedBits<'_>,
    motion: &Displacements<'_>,
    times: &[f32],
    valid: Option<ArrayView2<'_, u8>>,
    mut sums: ShiftedCounts<'_>,
) -> Result<()> {
    let (frames, rows, columns) = bits.shape();
    check(bits, times, valid, &sums)?;
    if frames == 0 || rows == 0 || columns == 0 {
        return Ok(());
    }
    let input = Input {
        bits: bits.contiguous(),
        valid: valid.map(contiguous_mask),
        motion,
        times,
        rows,
        columns,
    };
    let ShiftedCounts {
        ones,
        trials,
        remainders,
    } = &mut sums;
    ones.axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK)
        .into_par_iter()
        .zip(trials.axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK))
        .zip(remainders.axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK))
        .enumerate()
        .for_each(|(chunk, ((ones, trials), remainders))| {
            let part = ShiftedCounts {
                ones,
                trials,
                remainders,
            };
            count_rows(&input, chunk * ROWS_PER_TASK, part);
        });
    Ok(())
}

fn check(
    bits: &PackedBits<'_>,
    times: &[f32],
    valid: Option<ArrayView2<'_, u8>>,
    sums: &ShiftedCounts<'_>,
) -> Result<()> {
    let (frames, rows, columns) = bits.shape();
    if times.len() != frames {
        return Err(Error::shape("times of the frames", frames, times.len()));
    }
    if let Some(time) = times.iter().find(|time| !(-1.0..=2.0).contains(*time)) {
        return Err(Error::range("times of the frames", "-1 to 2", time));
    }
    check_mask(valid, rows, columns)?;
    for counts in [sums.ones.view(), sums.trials.view()] {
        if counts.dim() != (rows, columns) {
            return Err(Error::shape("counts", (rows, columns), counts.dim()));
        }
        let max = counts.iter().copied().max().unwrap_or(0);
        let frames = i32::try_from(frames).ok();
        if frames.and_then(|frames| max.checked_add(frames)).is_none() {
            let received = format!("a count of {max} and {} more bits", times.len());
            return Err(Error::range("counts", "sums of less than 2^31", received));
        }
    }
    let blocks = (rows, 2, columns.div_ceil(BLOCK));
    if sums.remainders.dim() != blocks {
        return Err(Error::shape("remainders", blocks, sums.remainders.dim()));
    }
    Ok(())
}

fn contiguous_mask(mask: ArrayView2<'_, u8>) -> Cow<'_, [u8]> {
    match mask.to_slice() {
        Some(bytes) => Cow::Borrowed(bytes),
        None => Cow::Owned(mask.iter().copied().collect()),
    }
}

levels! {
    /// Count some rows of pixels, of which `first_row` is the first.
    fn count_rows(
        input: &Input<'_, '_>, first_row: usize, sums: ShiftedCounts<'_>,
    ) = count_rows_inlined;
}

#[inline(always)]
fn count_rows_inlined(input: &Input<'_, '_>, first_row: usize, mut sums: ShiftedCounts<'_>) {
    let mut rows: Vec<RowCounter> = (first_row..first_row + sums.ones.nrows())
        .map(|row| RowCounter::new(input, row))
        .collect();
    for first_frame in (0..input.times.len()).step_by(FRAMES_PER_GROUP) {
        if interrupt::is_requested() {
            return;
        }
        for row in &mut rows {
            row.count_group(input, first_frame);
        }
    }
    let mut counts = vec![0; input.columns];
    for (index, row) in rows.iter().enumerate() {
        row.ones(&mut counts);
        let mut ones = sums.ones.row_mut(index);
        ones += &ArrayView1::from(&counts);
        row.trials(&mut counts);
        let mut trials = sums.trials.row_mut(index);
        trials += &ArrayView1::from(&counts);
        let displacements = row.motion.sums_of_displacements(input.times);
        for direction in 0..2 {
            let shifts = row.shifts[direction].iter().zip(&displacements[direction]);
            let remainders = sums.remainders.slice_mut(s![index, direction, ..]);
            for (sum, (shift, displacement)) in remainders.into_iter().zip(shifts) {
                *sum += shift - displacement;
            }
        }
    }
}
