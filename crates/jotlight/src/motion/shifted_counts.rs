//! Counts of the ones along a motion.

use std::borrow::Cow;

use ndarray::parallel::prelude::*;
use ndarray::{ArrayView2, ArrayViewMut1, ArrayViewMut2, ArrayViewMut3, Axis};

use super::field::Displacements;
use super::frames::{Frames, Input, Piece, check_size, check_times};
use super::lines::BLOCK;
use super::row::RowMotion;
use super::row_counter::RowCounters;
use super::source::Frame;
use crate::bits::{FRAMES_PER_GROUP, PackedBits, check_mask, trials};
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// The number of rows that one task counts. Its counters fit in the cache.
const ROWS_PER_TASK: usize = 16;

/// The sums along a motion, which [`count_shifted`] writes.
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

/// Count the ones of frames whose pixels are displaced, and write their numbers into `sums`.
///
/// `times[t]` is the time of frame t: at an integer n, it has the displacements of field n. Bits that
/// come from outside the frame, or whose bit in the packed mask `valid` `(H, ⌈W/8⌉)` is 0, are no
/// trials.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match, or the displacements are those of an
/// image of another size. [`Error::Range`] if a time is not in \[-1, m\] for m fields, a count could
/// exceed the `i32`, or a frame has more than 2^24 rows or columns, or 2^31 bytes.
pub fn count_shifted(
    bits: &PackedBits<'_>,
    motion: &Displacements<'_>,
    times: &[f64],
    valid: Option<ArrayView2<'_, u8>>,
    mut sums: ShiftedCounts<'_>,
) -> Result<()> {
    let (frames, rows, columns) = bits.shape();
    check(bits, motion, times, valid, &sums)?;
    trials(frames, 1)?;
    if frames == 0 || rows == 0 || columns == 0 {
        sums.ones.fill(0);
        sums.trials.fill(0);
        sums.remainders.fill(0.0);
        return Ok(());
    }
    let (pieces, times) = Piece::divide(times, motion.number());
    let mean = motion.mean(&Piece::shares(&pieces, &times, motion.number()));
    let input = Input {
        bits: (0..frames).map(|frame| bits.rows(frame, 0..rows)).collect(),
        valid: valid.map(contiguous_mask),
        motion,
        mean,
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
        .for_each_init(
            || Task::new(&input),
            |task, (chunk, ((ones, trials), remainders))| {
                let part = ShiftedCounts {
                    ones,
                    trials,
                    remainders,
                };
                count_rows(&input, chunk * ROWS_PER_TASK, task, part);
            },
        );
    Ok(())
}

/// What a task needs to count rows. Several tasks use it, one after the other.
struct Task<'a> {
    motions: Vec<RowMotion<'a>>,
    counters: RowCounters<'a>,
    /// The mean displacements and shifts of a row in one direction.
    values: Vec<f32>,
    displacements: Vec<f32>,
    shifts: Vec<f64>,
}

impl<'a> Task<'a> {
    fn new(input: &'a Input<'_, '_>) -> Self {
        let rows = ROWS_PER_TASK.min(input.frame.rows);
        let blocks = input.frame.columns.div_ceil(BLOCK);
        Self {
            motions: vec![RowMotion::new(input.motion); rows],
            counters: RowCounters::new(input, rows),
            values: vec![0.0; input.mean.padded_length()],
            displacements: vec![0.0; blocks],
            shifts: vec![0.0; blocks],
        }
    }
}

fn check(
    bits: &PackedBits<'_>,
    motion: &Displacements<'_>,
    times: &[f64],
    valid: Option<ArrayView2<'_, u8>>,
    sums: &ShiftedCounts<'_>,
) -> Result<()> {
    let (frames, rows, columns) = bits.shape();
    check_size(rows, columns)?;
    motion.check_size((rows, columns))?;
    if times.len() != frames {
        return Err(Error::shape("times of the frames", frames, times.len()));
    }
    check_times(times, motion.number())?;
    check_mask(valid, rows, columns)?;
    for counts in [sums.ones.view(), sums.trials.view()] {
        if counts.dim() != (rows, columns) {
            return Err(Error::shape("counts", (rows, columns), counts.dim()));
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
        input: &Input<'_, '_>, first_row: usize, task: &mut Task<'_>, sums: ShiftedCounts<'_>,
    ) = count_rows_inlined;
}

#[inline(always)]
fn count_rows_inlined(
    input: &Input<'_, '_>,
    first_row: usize,
    task: &mut Task<'_>,
    mut sums: ShiftedCounts<'_>,
) {
    let (rows, frames) = (sums.ones.nrows(), input.times.len());
    let (counters, motions) = (&mut task.counters, &mut task.motions[..rows]);
    counters.clear(first_row);
    for piece in &input.pieces {
        for (row, motion) in motions.iter_mut().enumerate() {
            motion.set(input.motion, piece.field, first_row + row);
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
    // The counters add to numbers of ones. These rows are in the cache afterward.
    sums.ones.fill(0);
    for row in 0..rows {
        with_slice(sums.ones.row_mut(row), |ones| counters.add_ones(row, ones));
        with_slice(sums.trials.row_mut(row), |trials| {
            counters.write_trials(row, frames, trials);
        });
        let mut remainders = sums.remainders.index_axis_mut(Axis(0), row);
        for (direction, mut remainders) in remainders.rows_mut().into_iter().enumerate() {
            let place = (0, direction);
            input
                .mean
                .read_row(place, first_row + row, &mut task.values);
            let columns = input.mean.columns();
            columns.average(&task.values, &mut task.displacements);
            counters.shifts(row).average(direction, &mut task.shifts);
            let means = task.shifts.iter().zip(&task.displacements);
            for (sum, (shift, &displacement)) in remainders.iter_mut().zip(means) {
                *sum = (shift - frames as f64 * f64::from(displacement)) as f32;
            }
        }
    }
}

/// Change a row as a slice.
fn with_slice(mut row: ArrayViewMut1<'_, i32>, change: impl FnOnce(&mut [i32])) {
    if let Some(slice) = row.as_slice_mut() {
        change(slice);
        return;
    }
    let mut copy = row.to_vec();
    change(&mut copy);
    for (value, copy) in row.iter_mut().zip(copy) {
        *value = copy;
    }
}
