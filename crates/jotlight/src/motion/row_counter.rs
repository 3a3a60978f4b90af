//! The counters of rows of pixels along a motion.

use std::ops::Range;

use super::frames::{Frames, Input};
use super::lines::{BLOCK, BLOCKS_PER_STEP, Blocks};
use super::row::{Pixels, RowMotion};
use super::search::{Found, Places, blocks_in, search};
use super::source::{Frame, Origins, PixelOrigins};
use crate::bits::{BitCounters, FRAMES_PER_GROUP};

/// Shifted blocks of bits, in a group of frames.
type Group = [Vec<[u8; BLOCK / 8]>; FRAMES_PER_GROUP];

/// Some shifted blocks of a row, in a group of frames.
type Buffer = [Blocks<u16>; FRAMES_PER_GROUP];

/// The counters of neighboring rows of pixels.
pub(super) struct RowCounters<'a> {
    frame: Frame,
    mask: Option<&'a [u8]>,
    first_row: usize,
    /// The number of blocks in a row.
    blocks: usize,
    ones: BitCounters,
    shifted: Group,
    /// The counters of valid bits and the shifted mask, if there is one.
    valid: Option<(BitCounters, Group)>,
    /// The number of frames in which a pixel comes from outside, if there is no mask.
    outside: Vec<[i32; BLOCK]>,
    /// The sum over frames of the shift of a row, where all pixels have the same shift.
    shifts_of_rows: Vec<[i64; 2]>,
    /// The sum over the other frames and over the pixels of each block.
    shifts_of_blocks: Vec<[i64; 2]>,
    /// The sum over all frames of the mean displacement of each block.
    displacements: Vec<[f64; 2]>,
    found: Vec<Found>,
}

impl<'a> RowCounters<'a> {
    #[inline(always)]
    pub fn new(input: &'a Input<'_, '_>, first_row: usize, rows: usize) -> Self {
        let blocks = input.frame.columns.div_ceil(BLOCK);
        let counters = || BitCounters::new(rows * blocks * BLOCK / 8);
        let group = || std::array::from_fn(|_| vec![[0; 2]; rows * blocks]);
        Self {
            frame: input.frame,
            mask: input.valid.as_deref(),
            first_row,
            blocks,
            ones: counters(),
            shifted: group(),
            valid: input.valid.as_ref().map(|_| (counters(), group())),
            outside: vec![[0; BLOCK]; rows * blocks],
            shifts_of_rows: vec![[0; 2]; rows],
            shifts_of_blocks: vec![[0; 2]; rows * blocks],
            displacements: vec![[0.0; 2]; rows * blocks],
            found: vec![Found::default(); blocks.div_ceil(BLOCKS_PER_STEP)],
        }
    }

    /// Return the sums of the displacements of the blocks of a row.
    pub fn displacements(&mut self, row: usize) -> &mut [[f64; 2]] {
        &mut self.displacements[row * self.blocks..(row + 1) * self.blocks]
    }

    /// Begin a group of frames: set the bits of frames after the last one to 0.
    #[inline(always)]
    pub fn begin_group(&mut self, frames: &Frames<'_>) {
        let groups = std::iter::once(&mut self.shifted);
        for group in groups.chain(self.valid.as_mut().map(|(_, mask)| mask)) {
            for blocks in &mut group[frames.times.number..] {
                blocks.fill([0; 2]);
            }
        }
    }

    /// Add the bits of a group, all of whose rows have been copied.
    #[inline(always)]
    pub fn end_group(&mut self) {
        self.ones
            .add(&self.shifted.each_ref().map(|blocks| blocks.as_flattened()));
        if let Some((counters, mask)) = &mut self.valid {
            counters.add(&mask.each_ref().map(|blocks| blocks.as_flattened()));
        }
    }

    /// Copy the bits of a row.
    #[inline(always)]
    pub fn copy_row(&mut self, row: usize, motion: &RowMotion<'_>, frames: &Frames<'_>) {
        let times = &frames.times;
        if let Some(shift) = motion.common_shift(times.range) {
            self.copy_whole_row(row, frames, 0..times.number, shift);
            return;
        }
        let mut shifts = [[0; 2]; FRAMES_PER_GROUP];
        for (shift, &time) in shifts.iter_mut().zip(&times.each) {
            let Some(common) = motion.common_shift([time; 2]) else {
                let mut found = std::mem::take(&mut self.found);
                search(motion, self.frame, self.first_row + row, times, &mut found);
                for (step, found) in found.iter().enumerate() {
                    self.copy_step((row, step), motion, found, frames);
                }
                self.found = found;
                return;
            };
            *shift = common;
        }
        for (index, &shift) in shifts[..times.number].iter().enumerate() {
            self.copy_whole_row(row, frames, index..index + 1, shift);
        }
    }

    /// Copy a row whose pixels have the same shift in some frames of a group.
    #[inline(always)]
    fn copy_whole_row(
        &mut self,
        row: usize,
        frames: &Frames<'_>,
        indices: Range<usize>,
        shift: [i32; 2],
    ) {
        let image_row = self.first_row + row;
        let blocks = row * self.blocks..(row + 1) * self.blocks;
        let inside = self.frame.columns_inside(image_row, shift);
        let number = indices.len();
        for index in indices {
            let source = frames.bytes[index];
            let target = self.shifted[index][blocks.clone()].as_flattened_mut();
            self.frame
                .copy_row(source, image_row, shift, inside.clone(), target);
            if let (Some(mask), Some((_, valid))) = (self.mask, &mut self.valid) {
                let valid = valid[index][blocks.clone()].as_flattened_mut();
                self.frame
                    .copy_row(mask, image_row, shift, inside.clone(), valid);
                for (bits, valid) in target.iter_mut().zip(valid) {
                    *bits &= *valid;
                }
            }
        }
        let outside = self.outside[blocks].as_flattened_mut();
        for count in &mut outside[..inside.start] {
            *count += number as i32;
        }
        for count in &mut outside[inside.end..] {
            *count += number as i32;
        }
        for (sum, shift) in self.shifts_of_rows[row].iter_mut().zip(shift) {
            *sum += i64::from(shift) * number as i64;
        }
    }

    /// Copy the blocks of a step of a row.
    #[inline(always)]
    fn copy_step(
        &mut self,
        (row, step): (usize, usize),
        motion: &RowMotion<'_>,
        found: &Found,
        frames: &Frames<'_>,
    ) {
        let number = frames.times.number;
        let first = step * BLOCKS_PER_STEP;
        let blocks = row * self.blocks + first..row * self.blocks + self.blocks;
        let blocks = blocks.start..blocks.end.min(blocks.start + BLOCKS_PER_STEP);
        let mut buffers = [[[0; BLOCKS_PER_STEP]; FRAMES_PER_GROUP]; 2];
        let mut uncertain = 0;
        if found.is_constant {
            let places = &found.places[0];
            self.copy_constant(&places.parts[0], frames, &mut buffers);
            self.count_outside(blocks.start, number, places);
        } else {
            for (index, places) in found.places[..number].iter().enumerate() {
                self.copy_parts(places, frames.bytes[index], index, &mut buffers);
                self.count_outside(blocks.start, 1, places);
                uncertain |= places.uncertain;
            }
        }
        for block in blocks_in(uncertain) {
            let pixels = motion.block(first + block);
            for (index, places) in found.places[..number].iter().enumerate() {
                if places.uncertain >> block & 1 == 1 {
                    let block = (row, first + block);
                    self.copy_pixels(block, &pixels, frames, index, &mut buffers);
                }
            }
        }
        for (block, sums) in self.shifts_of_blocks[blocks.clone()].iter_mut().enumerate() {
            for direction in 0..2 {
                sums[direction] += i64::from(found.shifts[direction][block]);
            }
        }
        store(&buffers[0], number, blocks.clone(), &mut self.shifted);
        if let Some((_, group)) = &mut self.valid {
            store(&buffers[1], number, blocks, group);
        }
    }

    /// Copy blocks that come from the same places in all frames.
    #[inline(always)]
    fn copy_constant(
        &self,
        origins: &Origins,
        frames: &Frames<'_>,
        [shifted, valid]: &mut [Buffer; 2],
    ) {
        for block in 0..BLOCKS_PER_STEP {
            let mut counted = u16::MAX;
            if let Some(mask) = self.mask {
                counted = origins.bits(mask, block);
                for valid in &mut *valid {
                    valid[block] = counted;
                }
            }
            for (shifted, source) in shifted.iter_mut().zip(frames.bytes) {
                shifted[block] = origins.bits(source, block) & counted;
            }
        }
    }

    /// Copy blocks with up to two parts in a frame.
    #[inline(always)]
    fn copy_parts(
        &self,
        places: &Places,
        source: &[u8],
        index: usize,
        [shifted, valid]: &mut [Buffer; 2],
    ) {
        let [first, second] = &places.parts;
        for block in 0..BLOCKS_PER_STEP {
            shifted[index][block] = first.bits(source, block);
        }
        if places.has_second_parts {
            for block in 0..BLOCKS_PER_STEP {
                shifted[index][block] |= second.bits(source, block);
            }
        }
        if let Some(mask) = self.mask {
            for block in 0..BLOCKS_PER_STEP {
                valid[index][block] = first.bits(mask, block);
                if places.has_second_parts {
                    valid[index][block] |= second.bits(mask, block);
                }
                shifted[index][block] &= valid[index][block];
            }
        }
    }

    /// Copy the pixels of a block one after the other in a frame.
    #[inline(always)]
    fn copy_pixels(
        &mut self,
        (row, block): (usize, usize),
        pixels: &[Pixels; 2],
        frames: &Frames<'_>,
        index: usize,
        [shifted, valid]: &mut [Buffer; 2],
    ) {
        let time = frames.times.each[index];
        let shifts = [pixels[0].shifts(time), pixels[1].shifts(time)];
        let length = (self.frame.columns - block * BLOCK).min(BLOCK);
        let (image_row, column) = (self.first_row + row, block * BLOCK);
        let origins = PixelOrigins::new(self.frame, image_row, column, length, &shifts);
        let mut bits = origins.bits(frames.bytes[index]);
        if let Some(mask) = self.mask {
            let counted = origins.bits(mask);
            bits &= counted;
            valid[index][block % BLOCKS_PER_STEP] = counted;
        } else {
            let outside = &mut self.outside[row * self.blocks + block];
            for (count, is_inside) in outside.iter_mut().zip(origins.are_inside) {
                *count += i32::from(is_inside == 0);
            }
        }
        shifted[index][block % BLOCKS_PER_STEP] = bits;
        let sums = &mut self.shifts_of_blocks[row * self.blocks + block];
        for (sum, shifts) in sums.iter_mut().zip(&shifts) {
            *sum += i64::from(shifts[..length].iter().sum::<i32>());
        }
    }

    /// Count the pixels of the blocks from `first` on that come from outside the frame, in some
    /// frames.
    #[inline(always)]
    fn count_outside(&mut self, first: usize, frames: usize, places: &Places) {
        for block in blocks_in(places.outside) {
            let mut inside = places.parts[0].inside[block];
            if places.has_second_parts {
                inside |= places.parts[1].inside[block];
            }
            for (pixel, count) in self.outside[first + block].iter_mut().enumerate() {
                *count += frames as i32 * (inside >> (BLOCK - 1 - pixel) & 1 ^ 1);
            }
        }
    }

    /// Replace `counts` with the number of ones of each pixel of a row.
    pub fn ones(&self, row: usize, counts: &mut [i32]) {
        counts.fill(0);
        self.ones.add_to_counts(self.bytes(row), counts);
    }

    /// Replace `counts` with the number of trials of each pixel of a row, in all frames.
    pub fn trials(&self, row: usize, frames: usize, counts: &mut [i32]) {
        if let Some((counters, _)) = &self.valid {
            counts.fill(0);
            counters.add_to_counts(self.bytes(row), counts);
            return;
        }
        let outside = &self.outside[row * self.blocks..(row + 1) * self.blocks];
        for (count, outside) in counts.iter_mut().zip(outside.as_flattened()) {
            *count = frames as i32 - outside;
        }
    }

    /// Return the sum over frames of the mean remainder of a block in one direction.
    #[inline(always)]
    pub fn remainder(&self, direction: usize, row: usize, block: usize) -> f32 {
        let index = row * self.blocks + block;
        let length = (self.frame.columns - block * BLOCK).min(BLOCK);
        let of_pixels = self.shifts_of_blocks[index][direction] as f64 / length as f64;
        let shift = self.shifts_of_rows[row][direction] as f64 + of_pixels;
        (shift - self.displacements[index][direction]) as f32
    }

    /// Return the bytes of a row in the counters.
    fn bytes(&self, row: usize) -> Range<usize> {
        let bytes = self.blocks * BLOCK / 8;
        row * bytes..(row + 1) * bytes
    }
}

/// Store blocks from a buffer.
#[inline(always)]
fn store(buffer: &Buffer, frames: usize, blocks: Range<usize>, group: &mut Group) {
    for (bits, group) in buffer[..frames].iter().zip(group) {
        for (target, bits) in group[blocks.clone()].iter_mut().zip(bits) {
            *target = bits.to_be_bytes();
        }
    }
}
