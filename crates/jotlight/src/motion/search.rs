//! The search for the places that the bits of a row come from.

use super::lines::{BLOCK, BLOCKS_PER_STEP, Blocks, Parts};
use super::row::RowMotion;
use super::source::{Frame, Origins, Words};
use crate::bits::FRAMES_PER_GROUP;

/// The times of a group of frames.
pub(super) struct Times {
    /// The number of frames.
    pub number: usize,
    /// The times. The last one fills the rest.
    pub each: [f32; FRAMES_PER_GROUP],
    /// The first and the last time.
    pub range: [f32; 2],
}

/// Where the bits of the blocks of a step come from, in a group of frames.
#[derive(Clone, Default)]
pub(super) struct Found {
    /// Whether the places are the same in all frames. Then only those of the first one are set.
    pub is_constant: bool,
    /// The blocks that are uncertain in some frame, and others that have pixels from outside, as
    /// numbers that are not 0.
    pub uncertain: Blocks<i32>,
    pub outside: Blocks<i32>,
    pub places: [Places; FRAMES_PER_GROUP],
    /// The sum of the shifts over the frames and pixels of the blocks that are certain.
    pub shifts: [Blocks<i32>; 2],
}

/// Where the bits of the blocks of a step come from in a frame.
#[derive(Clone, Default)]
pub(super) struct Places {
    /// The origins of the first part of each block, and of the second one if there are such parts.
    pub parts: [Origins; 2],
    /// Whether blocks have second parts.
    pub has_second_parts: bool,
    /// 1 for blocks whose pixels may have other shifts.
    pub uncertain: Blocks<i32>,
    /// The pixels of the other blocks that come from outside the frame. The first pixel is the
    /// highest bit.
    pub outside: Blocks<i32>,
}

/// Find the places that the bits of all steps of a row come from.
#[inline(always)]
pub(super) fn search(
    motion: &RowMotion<'_>,
    frame: Frame,
    row: usize,
    times: &Times,
    found: &mut [Found],
) {
    for (index, (step, found)) in motion.steps().iter().zip(found).enumerate() {
        let column = index * BLOCKS_PER_STEP * BLOCK;
        let mut lengths = [0; BLOCKS_PER_STEP];
        for block in 0..BLOCKS_PER_STEP {
            lengths[block] = motion.length(index * BLOCKS_PER_STEP + block) as i32;
        }
        let present = lengths.map(|length| i32::from(length > 0));
        let (shifts, differences) = step.common_shifts(times.range);
        found.is_constant = differences == [0; BLOCKS_PER_STEP];
        if found.is_constant {
            let places = &mut found.places[0];
            let origins = frame.origins(row, column, &shifts);
            places.has_second_parts = false;
            for block in 0..BLOCKS_PER_STEP {
                places.outside[block] = (origins.inside[block] ^ 0xffff) * present[block];
            }
            found.uncertain = [0; BLOCKS_PER_STEP];
            found.outside = places.outside;
            places.parts[0] = origins;
            for direction in 0..2 {
                for block in 0..BLOCKS_PER_STEP {
                    let pixels = lengths[block] * times.number as i32;
                    found.shifts[direction][block] = shifts[direction][block] * pixels;
                }
            }
            continue;
        }
        let (mut rows, mut columns) = ([0; BLOCKS_PER_STEP], [0; BLOCKS_PER_STEP]);
        let has_second_parts = !step.is_flat();
        let (mut uncertain, mut outside) = ([0; BLOCKS_PER_STEP], [0; BLOCKS_PER_STEP]);
        for (places, &time) in found.places[..times.number].iter_mut().zip(&times.each) {
            let parts = step.parts(time);
            places.has_second_parts = has_second_parts;
            places.set(&parts, frame, (row, column), &present);
            for block in 0..BLOCKS_PER_STEP {
                uncertain[block] |= places.uncertain[block];
                outside[block] |= places.outside[block];
            }
            add_shifts(&parts, 0, &lengths, &mut rows);
            add_shifts(&parts, 1, &lengths, &mut columns);
        }
        (found.uncertain, found.outside) = (uncertain, outside);
        found.shifts = [rows, columns];
    }
}

impl Places {
    /// Set the places of blocks from their parts and the position of the first pixel. Only some
    /// blocks are present.
    #[inline(always)]
    fn set(
        &mut self,
        parts: &Parts,
        frame: Frame,
        (row, column): (usize, usize),
        present: &Blocks<i32>,
    ) {
        let mut first = frame.origins(row, column, &parts.first);
        let mut inside = first.inside;
        if self.has_second_parts {
            let mut second = frame.origins(row, column, &parts.last);
            for block in 0..BLOCKS_PER_STEP {
                first.inside[block] &= !(0xffff >> parts.length[block]);
            }
            for block in 0..BLOCKS_PER_STEP {
                second.inside[block] &= 0xffff >> parts.length[block];
            }
            for block in 0..BLOCKS_PER_STEP {
                inside[block] = first.inside[block] | second.inside[block];
            }
            self.parts[1] = second;
        }
        self.parts[0] = first;
        for block in 0..BLOCKS_PER_STEP {
            self.uncertain[block] = (parts.is_certain[block] ^ 1) & present[block];
            let is_counted = parts.is_certain[block] & present[block];
            self.outside[block] = (inside[block] ^ 0xffff) & -is_counted;
        }
    }

    /// Return the bits of the step.
    #[inline(always)]
    pub fn bits(&self, source: &[u8]) -> Words {
        let mut words = self.parts[0].words(source);
        if self.has_second_parts {
            let second = self.parts[1].words(source);
            for (word, second) in words.iter_mut().zip(second) {
                *word |= second;
            }
        }
        words
    }
}

/// Add the sums of the shifts over the pixels of blocks that are certain, in one direction.
#[inline(always)]
fn add_shifts(parts: &Parts, direction: usize, lengths: &Blocks<i32>, sums: &mut Blocks<i32>) {
    let (first, last) = (parts.first[direction], parts.last[direction]);
    for block in 0..BLOCKS_PER_STEP {
        let number = parts.length[block].min(lengths[block]);
        let sum = last[block] * lengths[block] + (first[block] - last[block]) * number;
        sums[block] += sum * parts.is_certain[block];
    }
}

/// Return the blocks whose values are not 0.
#[inline(always)]
pub(super) fn blocks_in(values: &Blocks<i32>) -> impl Iterator<Item = usize> {
    (0..BLOCKS_PER_STEP).filter(|&block| values[block] != 0)
}
