//! Sums of the shifts of a row of pixels.

use super::lines::{BLOCK, BLOCKS_PER_STEP, Blocks};

/// The sums of the shifts of a row over frames, in rows and columns.
#[derive(Clone)]
pub(super) struct ShiftSums {
    columns: usize,
    /// The sum over the frames in which all pixels have the same shift.
    of_row: [i64; 2],
    /// The sum over the other frames and over the pixels of each block, step by step.
    of_blocks: Vec<[Blocks<f64>; 2]>,
}

impl ShiftSums {
    /// Return sums over no frames, for a number of columns.
    pub fn new(columns: usize) -> Self {
        let steps = columns.div_ceil(BLOCK * BLOCKS_PER_STEP);
        Self {
            columns,
            of_row: [0; 2],
            of_blocks: vec![[[0.0; BLOCKS_PER_STEP]; 2]; steps],
        }
    }

    /// Set all sums to 0.
    pub fn clear(&mut self) {
        self.of_row = [0; 2];
        self.of_blocks.fill([[0.0; BLOCKS_PER_STEP]; 2]);
    }

    /// Add a number of frames in which all pixels have the same shift.
    #[inline(always)]
    pub fn add_row(&mut self, shift: [i32; 2], frames: usize) {
        for (sum, shift) in self.of_row.iter_mut().zip(shift) {
            *sum += i64::from(shift) * frames as i64;
        }
    }

    /// Add sums over the pixels of the blocks of a step.
    #[inline(always)]
    pub fn add_step(&mut self, step: usize, shifts: &[Blocks<i32>; 2]) {
        for (sums, shifts) in self.of_blocks[step].iter_mut().zip(shifts) {
            for block in 0..BLOCKS_PER_STEP {
                sums[block] += f64::from(shifts[block]);
            }
        }
    }

    /// Add the shifts of the pixels of a block in a frame.
    #[inline(always)]
    pub fn add_pixels(&mut self, block: usize, shifts: [&[i32]; 2]) {
        let step = &mut self.of_blocks[block / BLOCKS_PER_STEP];
        for (sums, shifts) in step.iter_mut().zip(shifts) {
            sums[block % BLOCKS_PER_STEP] += f64::from(shifts.iter().sum::<i32>());
        }
    }

    /// Replace `means` with the mean shift of each block in one direction, added over all frames.
    #[inline(always)]
    pub fn average(&self, direction: usize, means: &mut [f64]) {
        let of_row = self.of_row[direction] as f64;
        for (means, sums) in means.chunks_mut(BLOCKS_PER_STEP).zip(&self.of_blocks) {
            for (mean, sum) in means.iter_mut().zip(sums[direction]) {
                *mean = of_row + sum / BLOCK as f64;
            }
        }
        let (block, length) = (self.columns / BLOCK, self.columns % BLOCK);
        if length > 0 {
            let sum = self.of_blocks[block / BLOCKS_PER_STEP][direction][block % BLOCKS_PER_STEP];
            means[block] = of_row + sum / length as f64;
        }
    }
}
