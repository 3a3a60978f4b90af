//! The displacements and shifts of a row of pixels.

use super::bounds::Bounds;
use super::columns::Columns;
use super::field::Displacements;
use super::lines::{BLOCK, BLOCKS_PER_STEP, BlockLine, Step};
use super::rounding::round;

/// The displacements of a row of pixels: `first + time · change`.
#[derive(Clone)]
pub(super) struct RowMotion<'a> {
    columns: &'a Columns,
    /// The values of [`Displacements::read_row`] in rows and in columns, at the first and at the
    /// last time.
    values: [[Vec<f32>; 2]; 2],
    steps: Vec<Step>,
    /// The bounds of all displacements, in rows and columns.
    bounds: [Bounds; 2],
}

impl<'a> RowMotion<'a> {
    /// Return a row that does not move.
    pub fn new(motion: &'a Displacements<'_>) -> Self {
        let columns = motion.columns();
        let blocks = columns.number().div_ceil(BLOCK);
        let values = || vec![0.0; motion.padded_length()];
        Self {
            columns,
            values: [[values(), values()], [values(), values()]],
            steps: vec![Step::default(); blocks.div_ceil(BLOCKS_PER_STEP)],
            bounds: [Bounds::default(); 2],
        }
    }

    /// Replace the displacements with those of a row, from a field to the next one, if there is one.
    #[inline(always)]
    pub fn set(&mut self, motion: &Displacements<'_>, field: usize, row: usize) {
        let fields = [field, (field + 1).min(motion.number() - 1)];
        for direction in 0..2 {
            for (values, field) in self.values[direction].iter_mut().zip(fields) {
                motion.read_row((field, direction), row, values);
            }
            for step in 0..self.steps.len() {
                self.set_lines(direction, step);
            }
            let [first, last] = &self.values[direction];
            self.bounds[direction] = Bounds::new(first, last);
        }
    }

    /// Set the lines of the blocks of a step in one direction.
    #[inline(always)]
    fn set_lines(&mut self, direction: usize, step: usize) {
        let first_block = step * BLOCKS_PER_STEP;
        let [first, last] = &self.values[direction];
        if self.columns.blocks_are_tiles()
            && let Some(first) = first[first_block..].first_chunk()
            && let Some(last) = last[first_block..].first_chunk()
        {
            self.steps[step].lines[direction].set_around_centers(first, last);
            self.steps[step].lines[direction].finish();
            return;
        }
        for index in 0..BLOCKS_PER_STEP {
            let Pixels { first, change } = self.pixels(direction, first_block + index);
            let line = BlockLine::through(&first, &change);
            self.steps[step].lines[direction].set(index, &line);
        }
        self.steps[step].lines[direction].finish();
    }

    /// Return the displacements of the pixels of a block in one direction.
    #[inline(always)]
    fn pixels(&self, direction: usize, block: usize) -> Pixels {
        let [first, last] = &self.values[direction];
        let first = self.columns.pixels(block, first);
        let mut change = self.columns.pixels(block, last);
        for pixel in 0..BLOCK {
            change[pixel] -= first[pixel];
        }
        Pixels { first, change }
    }

    /// Return the displacements of the pixels of a block, in rows and columns.
    #[inline(always)]
    pub fn block(&self, block: usize) -> [Pixels; 2] {
        [self.pixels(0, block), self.pixels(1, block)]
    }

    /// Return the shift of all pixels from the first to the last time, if they have only one.
    #[inline(always)]
    pub fn common_shift(&self, times: [f32; 2]) -> Option<[i32; 2]> {
        let [rows, columns] = [self.bounds[0].shifts(times), self.bounds[1].shifts(times)];
        if rows[0] == rows[1] && columns[0] == columns[1] {
            Some([rows[0], columns[0]])
        } else {
            None
        }
    }

    /// Return the number of pixels of a block.
    #[inline(always)]
    pub fn length(&self, block: usize) -> usize {
        self.columns.length(block)
    }

    /// Return the blocks, [`BLOCKS_PER_STEP`] at a time.
    #[inline(always)]
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }
}

/// The displacements of the pixels of a block in one direction.
pub(super) struct Pixels {
    first: [f32; BLOCK],
    change: [f32; BLOCK],
}

impl Pixels {
    /// Return the shifts at a time.
    #[inline(always)]
    pub fn shifts(&self, time: f32) -> [i32; BLOCK] {
        let mut shifts = [0; BLOCK];
        for pixel in 0..BLOCK {
            shifts[pixel] = round(self.first[pixel] + time * self.change[pixel]);
        }
        shifts
    }
}
