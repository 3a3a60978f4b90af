//! The displacements and shifts of a row of pixels.

use super::columns::Columns;
use super::field::Displacements;
use super::lines::{BLOCK, BLOCKS_PER_STEP, BlockLine, Bounds, Lines, Step, mean, round};
use crate::cpu::levels;

/// The displacements of a row of pixels: `first + time · change`.
#[derive(Clone)]
pub(super) struct RowMotion<'a> {
    columns: &'a Columns,
    /// The values of [`Displacements::read_row`].
    values: Vec<f32>,
    steps: Vec<Step>,
    /// The bounds of all displacements, in rows and columns.
    bounds: [Bounds; 2],
}

impl<'a> RowMotion<'a> {
    /// Return a row that does not move.
    pub fn new(columns: &'a Columns) -> Self {
        let blocks = columns.number().div_ceil(BLOCK);
        Self {
            columns,
            values: Vec::new(),
            steps: vec![Step::default(); blocks.div_ceil(BLOCKS_PER_STEP)],
            bounds: [Bounds::new(&[], 0); 2],
        }
    }

    /// Replace the displacements with those of a field and a row. Add the mean displacements of each
    /// block, in rows and columns: their sum over a number of times, given also the sum of the times.
    #[inline(always)]
    fn set_inlined(
        &mut self,
        motion: &Displacements<'_>,
        (field, row): (usize, usize),
        times: (usize, f64),
        sums: &mut [[f64; 2]],
    ) {
        motion.read_row(field, row, &mut self.values);
        for direction in 0..2 {
            for step in 0..self.steps.len() {
                let mut lines = Lines::default();
                for index in 0..BLOCKS_PER_STEP {
                    let block = step * BLOCKS_PER_STEP + index;
                    let line = self.line(direction, block);
                    lines.set(index, &line);
                    if let Some(sum) = sums.get_mut(block) {
                        let [first, change] = line.mean.map(f64::from);
                        sum[direction] += times.0 as f64 * first + times.1 * change;
                    }
                }
                self.steps[step].lines[direction] = lines;
            }
            self.bounds[direction] = Bounds::new(&self.steps, direction);
        }
    }

    /// Return the values in one direction at the first and at the last time.
    #[inline(always)]
    fn values(&self, direction: usize) -> [&[f32]; 2] {
        let length = self.values.len() / 4;
        let (first, last) = self.values[2 * direction * length..].split_at(length);
        [first, &last[..length]]
    }

    /// Return the displacements of a block in one direction, as a line.
    #[inline(always)]
    fn line(&self, direction: usize, block: usize) -> BlockLine {
        let Some(place) = self.columns.block_place(block) else {
            let Pixels { first, change } = self.pixels(direction, block);
            let length = self.length(block).max(1);
            return BlockLine {
                mean: [mean(&first, length), mean(&change, length)],
                ..BlockLine::through(&first, &change)
            };
        };
        let [first, last] = self.values(direction);
        let [first, last] = [place.ends(first), place.ends(last)];
        let (start, end) = (first.first_and_last, last.first_and_last);
        BlockLine {
            first: start,
            change: [end[0] - start[0], end[1] - start[1]],
            difference: first.corner.abs() + 2.0 * (last.corner - first.corner).abs(),
            magnitude: 3.0 * first.magnitude + 2.0 * last.magnitude,
            mean: [first.mean, last.mean - first.mean],
        }
    }

    /// Return the displacements of the pixels of a block in one direction.
    #[inline(always)]
    fn pixels(&self, direction: usize, block: usize) -> Pixels {
        let [first, last] = self.values(direction);
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
        let columns = self.columns.number();
        columns.saturating_sub(block * BLOCK).min(BLOCK)
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

levels! {
    /// Replace the displacements with those of a field and a row. Add the mean displacements of each
    /// block, in rows and columns: their sum over a number of times, given also the sum of the times.
    pub(super) fn set_row(
        target: &mut RowMotion<'_>, motion: &Displacements<'_>, field_and_row: (usize, usize),
        times: (usize, f64), sums: &mut [[f64; 2]],
    ) = RowMotion::set_inlined;
}
