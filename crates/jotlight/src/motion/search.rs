//! The search for the places that the bits of a row come from.

use super::lines::{BLOCK, BLOCKS_PER_STEP, Blocks, Parts};
use super::row::RowMotion;
use super::source::{Frame, Origins};
use crate::bits::FRAMES_PER_GROUP;
use crate::cpu::levels;

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
    pub places: [Places; FRAMES_PER_GROUP],
    /// The sum of the shifts over the frames and pixels of the blocks that are certain.
    pub shifts: [Blocks<i32>; 2],
}

/// Where the bits of the blocks of a step come from in a frame.
#[derive(Clone, Default)]
pub(super) struct Places {
    /// The origins of the first part of each block, and of the second one if there are such parts.
    pub parts: [Origins; 2],
    /// The blocks whose pixels may have other shifts, as bits. The first block is the lowest bit.
    pub uncertain: u32,
    /// The other blocks with pixels that come from outside the frame.
    pub outside: u32,
    /// Whether blocks have second parts.
    pub has_second_parts: bool,
}

levels! {
    /// Find the places that the bits of all steps of a row come from.
    pub(super) fn search(
        motion: &RowMotion<'_>, frame: Frame, row: usize, times: &Times, found: &mut [Found],
    ) = search_inlined;
}

#[inline(always)]
fn search_inlined(
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
        let present = bits(lengths);
        let (shifts, differences) = step.common_shifts(times.range);
        found.is_constant = differences == [0; BLOCKS_PER_STEP];
        if found.is_constant {
            let places = &mut found.places[0];
            places.parts[0] = frame.origins(row, column, &shifts);
            places.set_outside(present);
            for direction in 0..2 {
                for block in 0..BLOCKS_PER_STEP {
                    let pixels = lengths[block] * times.number as i32;
                    found.shifts[direction][block] = shifts[direction][block] * pixels;
                }
            }
            continue;
        }
        let (mut rows, mut columns) = ([0; BLOCKS_PER_STEP], [0; BLOCKS_PER_STEP]);
        for (places, &time) in found.places[..times.number].iter_mut().zip(&times.each) {
            let parts = step.parts(time);
            places.set(&parts, frame, (row, column), present);
            add_shifts(&parts, 0, &lengths, &mut rows);
            add_shifts(&parts, 1, &lengths, &mut columns);
        }
        found.shifts = [rows, columns];
    }
}

impl Places {
    /// Set the places of blocks without second parts, of which only some are present. The origins
    /// of the first parts are set.
    #[inline(always)]
    fn set_outside(&mut self, present: u32) {
        self.has_second_parts = false;
        self.uncertain = 0;
        let mut outside = self.parts[0].inside;
        for outside in &mut outside {
            *outside ^= 0xffff;
        }
        self.outside = bits(outside) & present;
    }

    /// Set the places of blocks from their parts and the position of the first pixel.
    #[inline(always)]
    fn set(&mut self, parts: &Parts, frame: Frame, (row, column): (usize, usize), present: u32) {
        let mut first = frame.origins(row, column, &parts.first);
        let (mut outside, mut uncertain) = (first.inside, parts.is_certain);
        self.has_second_parts = parts.length != [BLOCK as i32; BLOCKS_PER_STEP];
        if self.has_second_parts {
            let mut second = frame.origins(row, column, &parts.last);
            for block in 0..BLOCKS_PER_STEP {
                first.inside[block] &= !(0xffff >> parts.length[block]);
            }
            for block in 0..BLOCKS_PER_STEP {
                second.inside[block] &= 0xffff >> parts.length[block];
            }
            for block in 0..BLOCKS_PER_STEP {
                outside[block] = first.inside[block] | second.inside[block];
            }
            self.parts[1] = second;
        }
        for block in 0..BLOCKS_PER_STEP {
            outside[block] ^= 0xffff;
        }
        for block in 0..BLOCKS_PER_STEP {
            uncertain[block] ^= 1;
        }
        self.parts[0] = first;
        self.uncertain = bits(uncertain) & present;
        self.outside = bits(outside) & present & !self.uncertain;
    }
}

/// Add the sums of the shifts over the pixels of blocks that are certain, in one direction.
#[inline(always)]
fn add_shifts(parts: &Parts, direction: usize, lengths: &Blocks<i32>, sums: &mut Blocks<i32>) {
    let (first, last) = (parts.first[direction], parts.last[direction]);
    for block in 0..BLOCKS_PER_STEP {
        let number = parts.length[block].min(lengths[block]);
        let sum = first[block] * number + last[block] * (lengths[block] - number);
        sums[block] += sum * parts.is_certain[block];
    }
}

/// Return which values differ from 0, as bits. The first value is the lowest bit.
#[inline(always)]
fn bits(values: Blocks<i32>) -> u32 {
    if values == [0; BLOCKS_PER_STEP] {
        return 0;
    }
    let mut bits = 0;
    for (index, value) in values.into_iter().enumerate() {
        bits |= u32::from(value != 0) << index;
    }
    bits
}

/// Return the numbers of the blocks whose bits are 1.
#[inline(always)]
pub(super) fn blocks_in(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let block = bits.trailing_zeros() as usize;
        let is_any = bits != 0;
        bits &= bits.wrapping_sub(1);
        is_any.then_some(block)
    })
}
