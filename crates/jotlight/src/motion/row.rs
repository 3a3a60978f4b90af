//! The shifts of a row of pixels.

use super::field::Displacements;

/// The number of neighboring pixels whose shifts are searched together. It divides 64.
pub const BLOCK: usize = 16;

/// Stands for several shifts of a block.
pub(super) const SEVERAL: i32 = i32::MIN;

/// Neighboring pixels of a row that have the same shift.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Run {
    /// The first pixel.
    pub start: usize,
    /// The pixel after the last one.
    pub end: usize,
    /// The displacement in rows and columns, rounded to whole pixels.
    pub shift: [i32; 2],
}

/// The displacements of a row of pixels: `first + time · change`.
pub(super) struct RowMotion {
    first: [Vec<f32>; 2],
    change: [Vec<f32>; 2],
    /// The bounds of the whole row, and of each block.
    bounds_of_row: [Bounds; 2],
    bounds_of_blocks: [Bounds; 2],
}

/// Return x, rounded to the nearest whole number, for |x| < 2²². Halves become even numbers.
#[inline(always)]
fn round(x: f32) -> i32 {
    // At this magnitude, the last bit of the mantissa is worth 1. So the sum is rounded to a whole
    // number, and its low bits contain this number.
    const UNIT_ULP: f32 = 12_582_912.0;
    (x + UNIT_ULP)
        .to_bits()
        .wrapping_sub(UNIT_ULP.to_bits())
        .cast_signed()
}

impl RowMotion {
    pub fn new(motion: &Displacements<'_>, row: usize) -> Self {
        let [first, change] = motion.row(row);
        let bounds = |length| {
            [0, 1].map(|direction| Bounds::new(&first[direction], &change[direction], length))
        };
        Self {
            bounds_of_row: bounds(first[0].len()),
            bounds_of_blocks: bounds(BLOCK),
            first,
            change,
        }
    }

    /// Return the shift of all pixels from the first to the last time, if they have only one.
    #[inline(always)]
    pub fn common_shift(&self, times: [f32; 2]) -> Option<[i32; 2]> {
        let mut shift = [0; 2];
        for (shift, bounds) in shift.iter_mut().zip(&self.bounds_of_row) {
            let [low, high] = bounds.shifts(0, times);
            if low != high {
                return None;
            }
            *shift = low;
        }
        Some(shift)
    }

    /// Find the shifts of all blocks from the first to the last time, in both directions.
    ///
    /// Blocks with several shifts have the shift [`SEVERAL`].
    #[inline(always)]
    pub fn common_shifts_of_blocks(&self, times: [f32; 2], shifts: &mut [Vec<i32>; 2]) {
        for (shifts, bounds) in shifts.iter_mut().zip(&self.bounds_of_blocks) {
            for (block, shift) in shifts.iter_mut().enumerate() {
                let [low, high] = bounds.shifts(block, times);
                *shift = if low == high { low } else { SEVERAL };
            }
        }
    }

    /// Find the runs of a block at a time, and return the mean of the shifts.
    #[inline(always)]
    pub fn find_runs(&self, block: usize, time: f32, runs: &mut Vec<Run>) -> [f32; 2] {
        let start = block * BLOCK;
        let end = (start + BLOCK).min(self.first[0].len());
        let mut shifts = [[0; BLOCK]; 2];
        let mut sums = [0; 2];
        for direction in 0..2 {
            let first = &self.first[direction][start..end];
            let change = &self.change[direction][start..end];
            for ((shift, first), change) in shifts[direction].iter_mut().zip(first).zip(change) {
                *shift = round(first + time * change);
                sums[direction] += *shift;
            }
        }
        let [rows, columns] = &shifts;
        let mut begins = 0_u32;
        for pixel in 1..BLOCK {
            let differs = rows[pixel] != rows[pixel - 1] || columns[pixel] != columns[pixel - 1];
            begins |= u32::from(differs) << pixel;
        }
        begins &= (1 << (end - start)) - 1;
        runs.clear();
        let mut pixel = 0;
        loop {
            let next = if begins == 0 {
                end - start
            } else {
                begins.trailing_zeros() as usize
            };
            let shift = [rows[pixel], columns[pixel]];
            runs.push(Run {
                start: start + pixel,
                end: start + next,
                shift,
            });
            if begins == 0 {
                return sums.map(|sum| sum as f32 / (end - start) as f32);
            }
            begins &= begins - 1;
            pixel = next;
        }
    }

    /// Return the sum over frames of the mean displacement of each block, in both directions.
    pub fn sums_of_displacements(&self, times: &[f32]) -> [Vec<f32>; 2] {
        let sum: f64 = times.iter().copied().map(f64::from).sum();
        let mean = |values: &[f32]| {
            values.iter().copied().map(f64::from).sum::<f64>() / values.len() as f64
        };
        [0, 1].map(|direction| {
            let blocks = self.first[direction]
                .chunks(BLOCK)
                .zip(self.change[direction].chunks(BLOCK));
            let sum_of = |(first, change)| times.len() as f64 * mean(first) + sum * mean(change);
            blocks.map(|block| sum_of(block) as f32).collect()
        })
    }
}

/// Bounds of displacements in one direction, each of some neighboring pixels.
struct Bounds {
    first: [Vec<f32>; 2],
    change: [Vec<f32>; 2],
}

impl Bounds {
    /// Return the bounds of each `length` pixels.
    fn new(first: &[f32], change: &[f32], length: usize) -> Self {
        let range = |values: &[f32]| {
            let minimum = |part: &[f32]| part.iter().copied().fold(f32::INFINITY, f32::min);
            let maximum = |part: &[f32]| part.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let parts = || values.chunks(length.max(1));
            [
                parts().map(minimum).collect(),
                parts().map(maximum).collect(),
            ]
        };
        Self {
            first: range(first),
            change: range(change),
        }
    }

    /// Return the smallest and the largest shift from the first to the last time.
    #[inline(always)]
    fn shifts(&self, index: usize, times: [f32; 2]) -> [i32; 2] {
        let [low, high] = [self.change[0][index], self.change[1][index]];
        let [a, b, c, d] = [
            times[0] * low,
            times[0] * high,
            times[1] * low,
            times[1] * high,
        ];
        let low = self.first[0][index] + a.min(b).min(c.min(d));
        let high = self.first[1][index] + a.max(b).max(c.max(d));
        // The slack exceeds the rounding error of `f32`.
        let slack = 1e-3 + 1e-6 * low.abs().max(high.abs());
        [round(low - slack), round(high + slack)]
    }
}
