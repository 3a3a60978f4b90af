//! The counters of rows of pixels along a motion.

use std::ops::Range;

use super::frames::{Frames, Input};
use super::lines::{BLOCK, BLOCKS_PER_STEP};
use super::row::{Pixels, RowMotion};
use super::search::{Found, Places, blocks_in, search};
use super::shift_sums::ShiftSums;
use super::source::{Frame, PixelOrigins, WORD, WORDS_PER_STEP};
use crate::bits::{BitCounters, FRAMES_PER_GROUP};

/// Shifted bits, in a group of frames.
type Group = [Vec<[u8; WORD / 8]>; FRAMES_PER_GROUP];

/// The counters of neighboring rows of pixels.
pub(super) struct RowCounters<'a> {
    frame: Frame,
    mask: Option<&'a [u8]>,
    first_row: usize,
    /// The number of steps in a row.
    steps: usize,
    ones: BitCounters,
    shifted: Group,
    /// The counters of valid bits and the shifted mask, if there is one.
    valid: Option<(BitCounters, Group)>,
    /// For each row, the number of frames in which a pixel comes from outside, if there is no mask.
    /// The row is empty until there is such a pixel.
    outside: Vec<Vec<[i32; BLOCK]>>,
    shifts: Vec<ShiftSums>,
    found: Vec<Found>,
}

impl<'a> RowCounters<'a> {
    #[inline(always)]
    pub fn new(input: &'a Input<'_, '_>, rows: usize) -> Self {
        let steps = input.frame.columns.div_ceil(BLOCKS_PER_STEP * BLOCK);
        let words = rows * steps * WORDS_PER_STEP;
        let counters = || BitCounters::new(words * WORD / 8);
        let group = || std::array::from_fn(|_| vec![[0; WORD / 8]; words]);
        Self {
            frame: input.frame,
            mask: input.valid.as_deref(),
            first_row: 0,
            steps,
            ones: counters(),
            shifted: group(),
            valid: input.valid.as_ref().map(|_| (counters(), group())),
            outside: vec![Vec::new(); rows],
            shifts: vec![ShiftSums::new(input.frame.columns); rows],
            found: vec![Found::default(); steps],
        }
    }

    /// Set all counters to 0, for rows from `first_row` on.
    pub fn clear(&mut self, first_row: usize) {
        self.first_row = first_row;
        self.ones.clear();
        if let Some((counters, _)) = &mut self.valid {
            counters.clear();
        }
        self.outside.iter_mut().for_each(Vec::clear);
        self.shifts.iter_mut().for_each(ShiftSums::clear);
    }

    /// Begin a group of frames: set the bits of frames after the last one to 0.
    #[inline(always)]
    pub fn begin_group(&mut self, frames: &Frames<'_>) {
        let groups = std::iter::once(&mut self.shifted);
        for group in groups.chain(self.valid.as_mut().map(|(_, mask)| mask)) {
            for words in &mut group[frames.times.number..] {
                words.fill([0; WORD / 8]);
            }
        }
    }

    /// Add the bits of a group, all of whose rows have been copied.
    #[inline(always)]
    pub fn end_group(&mut self) {
        self.ones
            .add(&self.shifted.each_ref().map(|words| words.as_flattened()));
        if let Some((counters, mask)) = &mut self.valid {
            counters.add(&mask.each_ref().map(|words| words.as_flattened()));
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
        // Pixels that differ in a frame, because a shift changes within the row, are searched.
        let (mut others, mut number) = ([0; FRAMES_PER_GROUP], 0);
        for (index, &time) in times.each[..times.number].iter().enumerate() {
            if let Some(shift) = motion.common_shift([time; 2]) {
                self.copy_whole_row(row, frames, index..index + 1, shift);
            } else {
                others[number] = index;
                number += 1;
            }
        }
        if number == 0 {
            return;
        }
        let frames = &frames.some(&others[..number]);
        let mut found = std::mem::take(&mut self.found);
        search(
            motion,
            self.frame,
            self.first_row + row,
            &frames.times,
            &mut found,
        );
        for (step, found) in found.iter().enumerate() {
            self.copy_step((row, step), motion, found, frames);
        }
        self.found = found;
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
        let words = self.words(row);
        let inside = self.frame.columns_inside(image_row, shift);
        let number = indices.len();
        for index in indices {
            let source = frames.bytes[index];
            let target = &mut self.shifted[index][words.clone()];
            self.frame
                .copy_row(source, image_row, shift, inside.clone(), target);
            if let (Some(mask), Some((_, valid))) = (self.mask, &mut self.valid) {
                let valid = &mut valid[index][words.clone()];
                self.frame
                    .copy_row(mask, image_row, shift, inside.clone(), valid);
                let valid = valid.as_flattened().iter();
                for (bits, valid) in target.as_flattened_mut().iter_mut().zip(valid) {
                    *bits &= *valid;
                }
            }
        }
        if inside.len() < self.frame.columns {
            let outside = self.outside(row).as_flattened_mut();
            for count in &mut outside[..inside.start] {
                *count += number as i32;
            }
            for count in &mut outside[inside.end..] {
                *count += number as i32;
            }
        }
        self.shifts[row].add_row(shift, number);
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
        let (places, repeated) = if found.is_constant {
            (&found.places[..1], number)
        } else {
            (&found.places[..number], 1)
        };
        for index in 0..number {
            let places = &places[index / repeated];
            let (source, index) = (frames.bytes[index], frames.indices[index]);
            self.copy_words((row, step), places, source, index);
        }
        if found.outside != [0; BLOCKS_PER_STEP] {
            self.count_outside((row, step), repeated, found, places);
        }
        if found.uncertain != [0; BLOCKS_PER_STEP] {
            self.copy_uncertain((row, step), motion, found, frames);
        }
        self.shifts[row].add_step(step, &found.shifts);
    }

    /// Copy the words of a step in a frame.
    #[inline(always)]
    fn copy_words(
        &mut self,
        (row, step): (usize, usize),
        places: &Places,
        source: &[u8],
        index: usize,
    ) {
        let first = (row * self.steps + step) * WORDS_PER_STEP;
        let words = first..first + WORDS_PER_STEP;
        let mut shifted = places.bits(source);
        if let (Some(mask), Some((_, valid))) = (self.mask, &mut self.valid) {
            let counted = places.bits(mask);
            for (target, (shifted, counted)) in valid[index][words.clone()]
                .iter_mut()
                .zip(shifted.iter_mut().zip(counted))
            {
                *shifted &= counted;
                *target = counted.to_be_bytes();
            }
        }
        for (target, word) in self.shifted[index][words].iter_mut().zip(shifted) {
            *target = word.to_be_bytes();
        }
    }

    /// Copy the pixels of the blocks of a step that are uncertain in some frames of a group.
    #[inline(always)]
    fn copy_uncertain(
        &mut self,
        (row, step): (usize, usize),
        motion: &RowMotion<'_>,
        found: &Found,
        frames: &Frames<'_>,
    ) {
        for block in blocks_in(&found.uncertain) {
            let in_row = step * BLOCKS_PER_STEP + block;
            let pixels = motion.block(in_row);
            for (index, places) in found.places[..frames.times.number].iter().enumerate() {
                if places.uncertain[block] != 0 {
                    self.copy_pixels((row, in_row), &pixels, frames, index);
                }
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
    ) {
        let time = frames.times.each[index];
        let shifts = [pixels[0].shifts(time), pixels[1].shifts(time)];
        let length = (self.frame.columns - block * BLOCK).min(BLOCK);
        let (image_row, column) = (self.first_row + row, block * BLOCK);
        let origins = PixelOrigins::new(self.frame, image_row, column, length, &shifts);
        let first = self.words(row).start * WORD / 8 + block * BLOCK / 8;
        let bytes = first..first + BLOCK / 8;
        let mut bits = origins.bits(frames.bytes[index]);
        let index = frames.indices[index];
        if let (Some(mask), Some((_, valid))) = (self.mask, &mut self.valid) {
            let counted = origins.bits(mask);
            bits &= counted;
            valid[index].as_flattened_mut()[bytes.clone()].copy_from_slice(&counted.to_be_bytes());
        } else if origins.are_inside != [1; BLOCK] {
            let outside = &mut self.outside(row)[block];
            for (count, is_inside) in outside.iter_mut().zip(origins.are_inside) {
                *count += i32::from(is_inside == 0);
            }
        }
        self.shifted[index].as_flattened_mut()[bytes].copy_from_slice(&bits.to_be_bytes());
        self.shifts[row].add_pixels(block, shifts.each_ref().map(|shifts| &shifts[..length]));
    }

    /// Count the pixels of a step that come from outside. Each place is that in some frames.
    #[inline(always)]
    fn count_outside(
        &mut self,
        (row, step): (usize, usize),
        frames: usize,
        found: &Found,
        places: &[Places],
    ) {
        let counts = &mut self.outside(row)[step * BLOCKS_PER_STEP..][..BLOCKS_PER_STEP];
        for block in blocks_in(&found.outside) {
            for places in places {
                for (pixel, count) in counts[block].iter_mut().enumerate() {
                    *count += frames as i32 * (places.outside[block] >> (BLOCK - 1 - pixel) & 1);
                }
            }
        }
    }

    /// Return the number of frames in which each pixel of a row comes from outside.
    #[inline(always)]
    fn outside(&mut self, row: usize) -> &mut [[i32; BLOCK]] {
        let blocks = self.steps * BLOCKS_PER_STEP;
        let outside = &mut self.outside[row];
        if outside.is_empty() {
            outside.resize(blocks, [0; BLOCK]);
        }
        outside
    }

    /// Add the number of ones of each pixel of a row to `counts`.
    pub fn add_ones(&self, row: usize, counts: &mut [i32]) {
        self.ones.add_to_counts(self.bytes(row), counts);
    }

    /// Replace `counts` with the number of trials of each pixel of a row, in all frames.
    pub fn write_trials(&self, row: usize, frames: usize, counts: &mut [i32]) {
        if let Some((counters, _)) = &self.valid {
            counts.fill(0);
            counters.add_to_counts(self.bytes(row), counts);
            return;
        }
        counts.fill(frames as i32);
        for (count, outside) in counts.iter_mut().zip(self.outside[row].as_flattened()) {
            *count -= outside;
        }
    }

    /// Return the sums of the shifts of a row.
    pub fn shifts(&self, row: usize) -> &ShiftSums {
        &self.shifts[row]
    }

    /// Return the words of a row.
    fn words(&self, row: usize) -> Range<usize> {
        let words = self.steps * WORDS_PER_STEP;
        row * words..(row + 1) * words
    }

    /// Return the bytes of a row in the counters.
    fn bytes(&self, row: usize) -> Range<usize> {
        let bytes = self.steps * WORDS_PER_STEP * WORD / 8;
        row * bytes..(row + 1) * bytes
    }
}
