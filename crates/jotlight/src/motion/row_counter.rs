//! The counters of a row of pixels along a motion.

use std::borrow::Cow;
use std::ops::Range;

use super::field::Displacements;
use super::row::{BLOCK, RowMotion, Run, SEVERAL};
use crate::bits::{BitCounters, FRAMES_PER_GROUP, MAX_FIELD_BITS, bit_field, copy_bytes};

/// The bits and their motion.
pub(super) struct Input<'a, 'b> {
    pub bits: Cow<'a, [u8]>,
    pub valid: Option<Cow<'a, [u8]>>,
    pub motion: &'a Displacements<'b>,
    pub times: &'a [f32],
    pub rows: usize,
    pub columns: usize,
}

impl Input<'_, '_> {
    /// Return the number of bytes of a row.
    fn row_bytes(&self) -> usize {
        self.columns.div_ceil(8)
    }

    /// Return the bytes of a frame and all that follow it.
    #[inline(always)]
    fn frame(&self, frame: usize) -> &[u8] {
        &self.bits[frame * self.rows * self.row_bytes()..]
    }
}

/// The shifted bits of a row in a group of frames.
type Group = [Vec<[u8; 8]>; FRAMES_PER_GROUP];

/// The counters of a row of pixels.
pub(super) struct RowCounter {
    row: usize,
    pub motion: RowMotion,
    ones: BitCounters,
    shifted: Group,
    /// The counters of valid bits and the shifted mask, if there is one.
    valid: Option<(BitCounters, Group)>,
    /// How much the number of trials increases from each pixel to the next, if there is no mask.
    steps: Vec<i32>,
    /// The sum of the mean shifts of each block over the frames, in rows and columns.
    pub shifts: [Vec<f32>; 2],
    /// Whether the bits of each block have yet to be copied.
    is_pending: Vec<bool>,
    shifts_of_blocks: [Vec<i32>; 2],
    runs: Vec<Run>,
}

impl RowCounter {
    pub fn new(input: &Input<'_, '_>, row: usize) -> Self {
        let words = input.columns.div_ceil(64);
        let blocks = input.columns.div_ceil(BLOCK);
        let group = || std::array::from_fn(|_| vec![[0; 8]; words]);
        Self {
            row,
            motion: RowMotion::new(input.motion, row),
            ones: BitCounters::new(8 * words),
            shifted: group(),
            valid: input
                .valid
                .as_ref()
                .map(|_| (BitCounters::new(8 * words), group())),
            steps: vec![0; input.columns + 1],
            shifts: [vec![0.0; blocks], vec![0.0; blocks]],
            is_pending: vec![true; blocks],
            shifts_of_blocks: [vec![0; blocks], vec![0; blocks]],
            runs: Vec::new(),
        }
    }

    /// Count the group of frames that begins with `first_frame`.
    #[inline(always)]
    pub fn count_group(&mut self, input: &Input<'_, '_>, first_frame: usize) {
        for bits in self
            .shifted
            .iter_mut()
            .chain(self.valid.iter_mut().flat_map(|(_, mask)| mask))
        {
            bits.fill([0; 8]);
        }
        let times = &input.times[first_frame..];
        let times = &times[..times.len().min(FRAMES_PER_GROUP)];
        let range = times.iter().fold([times[0]; 2], |[low, high], &time| {
            [low.min(time), high.max(time)]
        });
        let frames = first_frame..first_frame + times.len();
        if let Some(shift) = self.motion.common_shift(range) {
            for (sums, shift) in self.shifts.iter_mut().zip(shift) {
                for sum in sums {
                    *sum += shift as f32 * times.len() as f32;
                }
            }
            let run = Run {
                start: 0,
                end: input.columns,
                shift,
            };
            self.copy(input, frames, first_frame, run);
        } else {
            self.is_pending.fill(true);
            self.copy_blocks(input, frames.clone(), first_frame, range, false);
            if self.is_pending.contains(&true) {
                for (frame, &time) in frames.zip(times) {
                    self.copy_blocks(input, frame..frame + 1, first_frame, [time; 2], true);
                }
            }
        }
        for (ones, valid) in self
            .shifted
            .iter_mut()
            .zip(self.valid.iter().flat_map(|(_, mask)| mask))
        {
            for (ones, valid) in ones.as_flattened_mut().iter_mut().zip(valid.as_flattened()) {
                *ones &= valid;
            }
        }
        self.ones
            .add(&self.shifted.each_ref().map(|words| words.as_flattened()));
        if let Some((counters, mask)) = &mut self.valid {
            counters.add(&mask.each_ref().map(|words| words.as_flattened()));
        }
    }

    /// Copy the bits of the pending blocks, in some frames of the group.
    ///
    /// Blocks with several shifts remain pending. They are copied frame by frame if `search` is
    /// true.
    #[inline(always)]
    fn copy_blocks(
        &mut self,
        input: &Input<'_, '_>,
        frames: Range<usize>,
        first_frame: usize,
        times: [f32; 2],
        search: bool,
    ) {
        let mut shifts = std::mem::take(&mut self.shifts_of_blocks);
        self.motion.common_shifts_of_blocks(times, &mut shifts);
        let mut run = Run {
            start: 0,
            end: 0,
            shift: [0; 2],
        };
        for block in 0..shifts[0].len() {
            let shift = [shifts[0][block], shifts[1][block]];
            if !self.is_pending[block] {
                continue;
            }
            if shift.contains(&SEVERAL) {
                if search {
                    self.copy_block(input, frames.start, first_frame, block, times[0]);
                }
                continue;
            }
            self.is_pending[block] = search;
            for (sums, shift) in self.shifts.iter_mut().zip(shift) {
                sums[block] += shift as f32 * frames.len() as f32;
            }
            let (start, end) = (block * BLOCK, ((block + 1) * BLOCK).min(input.columns));
            if run.end == start && run.shift == shift {
                run.end = end;
                continue;
            }
            self.copy(input, frames.clone(), first_frame, run);
            run = Run { start, end, shift };
        }
        self.copy(input, frames, first_frame, run);
        self.shifts_of_blocks = shifts;
    }

    /// Copy the bits of a block that has several shifts, in one frame.
    #[inline(always)]
    fn copy_block(
        &mut self,
        input: &Input<'_, '_>,
        frame: usize,
        first_frame: usize,
        block: usize,
        time: f32,
    ) {
        let mut runs = std::mem::take(&mut self.runs);
        let mean = self.motion.find_runs(block, time, &mut runs);
        for (sums, mean) in self.shifts.iter_mut().zip(mean) {
            sums[block] += mean;
        }
        for &run in &runs {
            self.copy(input, frame..frame + 1, first_frame, run);
        }
        self.runs = runs;
    }

    /// Copy the bits of a run, in some frames of the group.
    #[inline(always)]
    fn copy(&mut self, input: &Input<'_, '_>, frames: Range<usize>, first_frame: usize, run: Run) {
        let Some((row, run)) = inside(run, self.row, input.rows, input.columns) else {
            return;
        };
        let from = run.start.wrapping_add_signed(run.shift[1] as isize);
        let from = 8 * row * input.row_bytes() + from;
        if self.valid.is_none() {
            self.steps[run.start] += frames.len() as i32;
            self.steps[run.end] -= frames.len() as i32;
        }
        let (mut start, end) = (run.start, run.end);
        while start < end {
            let from = from + start - run.start;
            let length = if start.is_multiple_of(64) && end - start >= 64 {
                (end - start) / 64 * 64
            } else {
                (end - start).min(64 - start % 64).min(MAX_FIELD_BITS)
            };
            let part = Part {
                from,
                start,
                length,
            };
            for frame in frames.clone() {
                part.copy(input.frame(frame), &mut self.shifted[frame - first_frame]);
            }
            if let (Some((_, masks)), Some(valid)) = (&mut self.valid, &input.valid) {
                for frame in frames.clone() {
                    part.copy(valid, &mut masks[frame - first_frame]);
                }
            }
            start += length;
        }
    }

    /// Replace `counts` with the number of ones of each pixel.
    pub fn ones(&self, counts: &mut [i32]) {
        counts.fill(0);
        self.ones
            .add_to_counts(0..8 * self.shifted[0].len(), counts);
    }

    /// Replace `counts` with the number of trials of each pixel.
    pub fn trials(&self, counts: &mut [i32]) {
        counts.fill(0);
        if let Some((counters, _)) = &self.valid {
            counters.add_to_counts(0..8 * self.shifted[0].len(), counts);
            return;
        }
        let mut sum = 0;
        for (count, step) in counts.iter_mut().zip(&self.steps) {
            sum += step;
            *count = sum;
        }
    }
}

/// A part of a run: whole words, or up to [`MAX_FIELD_BITS`] bits in one word.
#[derive(Clone, Copy)]
struct Part {
    /// The place of its first bit in the source.
    from: usize,
    /// The place of its first bit in the target.
    start: usize,
    length: usize,
}

impl Part {
    /// Copy the part. Its bits in the target are 0.
    #[inline(always)]
    fn copy(self, source: &[u8], target: &mut [[u8; 8]]) {
        let Self {
            from,
            start,
            length,
        } = self;
        let word = start / 64;
        if length >= 64 {
            let words = &mut target[word..word + length / 64];
            copy_bytes(source, from, words.as_flattened_mut());
        } else {
            let bits = bit_field(source, from, length) << (64 - length - start % 64);
            target[word] = (u64::from_be_bytes(target[word]) | bits).to_be_bytes();
        }
    }
}

/// Return the row that a run comes from, and the part of the run that comes from inside the frame.
#[inline(always)]
fn inside(run: Run, row: usize, rows: usize, columns: usize) -> Option<(usize, Run)> {
    let row = row.checked_add_signed(run.shift[0] as isize)?;
    let shift = run.shift[1] as isize;
    let end = columns.saturating_add_signed(-shift).min(run.end);
    let start = run.start.max(0usize.saturating_add_signed(-shift));
    (row < rows && start < end).then_some((row, Run { start, end, ..run }))
}
