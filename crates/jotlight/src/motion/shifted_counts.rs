//! Counts of the ones along a motion.

use std::borrow::Cow;

use ndarray::parallel::prelude::*;
use ndarray::{ArrayView1, ArrayView2, ArrayViewMut2, ArrayViewMut3, Axis};

pub use super::lines::BLOCK;

use super::field::Displacements;
use super::frames::{Frames, Input, Piece};
use super::row::{RowMotion, set_row};
use super::row_counter::RowCounters;
use super::source::Frame;
use crate::bits::{FRAMES_PER_GROUP, PackedBits, check_mask, check_sum, packed_width, trials};
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// The maximum number of rows and columns, up to which `f32` represents positions of pixels.
const MAX_SIZE: usize = 1 << 24;

/// The maximum number of bytes of a frame. Their indices are `i32`.
const MAX_FRAME_BYTES: usize = i32::MAX as usize;

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
/// `times[t]` is the time of frame t: at an integer n, it has the displacements of field n. Bits that come from outside the frame, or whose bit in the packed mask `valid`
/// `(H, ⌈W/8⌉)` is 0, are no trials.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if a time is not in
/// \[-1, m\] for m fields, a count could exceed the `i32`, or a frame has more than 2^24 rows or columns, or 2^31
/// bytes.
pub fn add_shifted_counts(
    bits: &PackedBits<'_>,
    motion: &Displacements<'_>,
    times: &[f64],
    valid: Option<ArrayView2<'_, u8>>,
    mut sums: ShiftedCounts<'_>,
) -> Result<()> {
    let (frames, rows, columns) = bits.shape();
    check(bits, times, motion.number(), valid, &sums)?;
    if frames == 0 || rows == 0 || columns == 0 {
        return Ok(());
    }
    let (pieces, times) = Piece::divide(times, motion.number());
    let input = Input {
        bits: bits.contiguous(),
        valid: valid.map(contiguous_mask),
        motion,
        times,
        pieces,
        frame: Frame { rows, columns },
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
    times: &[f64],
    fields: usize,
    valid: Option<ArrayView2<'_, u8>>,
    sums: &ShiftedCounts<'_>,
) -> Result<()> {
    let (frames, rows, columns) = bits.shape();
    if rows.max(columns) > MAX_SIZE || rows * packed_width(columns) > MAX_FRAME_BYTES {
        let expected = format!("at most {MAX_SIZE} rows and columns, and {MAX_FRAME_BYTES} bytes");
        return Err(Error::range(
            "frames",
            expected,
            format!("{rows} x {columns}"),
        ));
    }
    if times.len() != frames {
        return Err(Error::shape("times of the frames", frames, times.len()));
    }
    let range = -1.0..=fields as f64;
    if let Some(time) = times.iter().find(|time| !range.contains(*time)) {
        let expected = format!("-1 to {fields}");
        return Err(Error::range("times of the frames", expected, time));
    }
    check_mask(valid, rows, columns)?;
    for counts in [sums.ones.view(), sums.trials.view()] {
        if counts.dim() != (rows, columns) {
            return Err(Error::shape("counts", (rows, columns), counts.dim()));
        }
        check_sum(trials(frames, 1)?, counts)?;
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
    let (rows, frames) = (sums.ones.nrows(), input.times.len());
    let mut counters = RowCounters::new(input, first_row, rows);
    let mut motions = vec![RowMotion::new(input.motion.columns()); rows];
    for piece in &input.pieces {
        let times = input.times[piece.frames.clone()].iter();
        let time: f64 = times.copied().map(f64::from).sum();
        for (row, motion) in motions.iter_mut().enumerate() {
            let sums = counters.displacements(row);
            let times = (piece.frames.len(), time);
            set_row(
                motion,
                input.motion,
                (piece.field, first_row + row),
                times,
                sums,
            );
        }
        for first in piece.frames.clone().step_by(FRAMES_PER_GROUP) {
            if interrupt::is_requested() {
                return;
            }
            let group = Frames::new(input, first, piece.frames.end);
            counters.begin_group(&group);
            for (row, motion) in motions.iter().enumerate() {
                counters.copy_row(row, motion, &group);
            }
            counters.end_group();
        }
    }
    let mut counts = vec![0; input.frame.columns];
    for row in 0..rows {
        counters.ones(row, &mut counts);
        let mut ones = sums.ones.row_mut(row);
        ones += &ArrayView1::from(&counts);
        counters.trials(row, frames, &mut counts);
        let mut trials = sums.trials.row_mut(row);
        trials += &ArrayView1::from(&counts);
        let mut remainders = sums.remainders.index_axis_mut(Axis(0), row);
        for (direction, mut remainders) in remainders.rows_mut().into_iter().enumerate() {
            for (block, sum) in remainders.iter_mut().enumerate() {
                *sum += counters.remainder(direction, row, block);
            }
        }
    }
}
