//! Displacements of blocks of pixels, searched for parts with one shift.

use super::rounding::{fold, fold_halves, margin, max, min, round};

/// The number of neighboring pixels whose shifts are searched together.
pub const BLOCK: usize = 16;

/// The number of neighboring blocks whose shifts are searched together.
pub(super) const BLOCKS_PER_STEP: usize = 16;

/// A number for each block of a step.
pub(super) type Blocks<T> = [T; BLOCKS_PER_STEP];

/// The numbers of the pixels of a block.
const PIXELS: [f32; BLOCK] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

/// Values at the centers of the blocks of a step, and of one block before and after them.
pub(super) type Centers = [f32; BLOCKS_PER_STEP + 2];

/// Displacements of blocks in one direction. They are nearly linear functions of the pixel.
#[derive(Clone, Copy, Default)]
pub(super) struct Lines {
    /// The first values of the first and the last pixel.
    first: [Blocks<f32>; 2],
    /// Their changes.
    change: [Blocks<f32>; 2],
    /// The maximum difference between a displacement and the line through the first and the last
    /// one, at any time from -1 to 2, with errors of rounding.
    margin: Blocks<f32>,
    /// Whether the first and the last pixel of each block always have the same displacement. Then no
    /// block is divided.
    ///
    /// This does not depend on the time. A branch for each frame made counting up to a fifth slower.
    is_flat: bool,
}

impl Lines {
    /// Update what depends on all blocks, after each of them was set.
    #[inline(always)]
    pub fn finish(&mut self) {
        let [first, change] =
            [self.first, self.change].map(|ends| ends.map(|end| end.map(f32::to_bits)));
        self.is_flat = first[0] == first[1] && change[0] == change[1];
    }

    /// Replace the line of a block.
    #[inline(always)]
    pub fn set(&mut self, block: usize, line: &BlockLine) {
        self.first[0][block] = line.first[0];
        self.first[1][block] = line.first[1];
        self.change[0][block] = line.change[0];
        self.change[1][block] = line.change[1];
        self.margin[block] = margin(line.difference, line.magnitude);
    }

    /// Replace the lines with those around the centers of tiles that are as wide as a block, given the
    /// first and the last values at these centers and at those of their neighbors on both sides.
    #[inline(always)]
    pub fn set_around_centers(&mut self, first: &Centers, last: &Centers) {
        // The distance of the first and the last pixel from the center, in tiles.
        const DISTANCE: f32 = (BLOCK - 1) as f32 / 2.0 / BLOCK as f32;
        for i in 0..BLOCKS_PER_STEP {
            let (value, left, right) = (
                first[i + 1],
                first[i] - first[i + 1],
                first[i + 2] - first[i + 1],
            );
            let ends = [value + DISTANCE * left, value + DISTANCE * right];
            let corner = left + right;
            let magnitude = value.abs() + left.abs() + right.abs();
            let (value, left, right) = (
                last[i + 1],
                last[i] - last[i + 1],
                last[i + 2] - last[i + 1],
            );
            self.first[0][i] = ends[0];
            self.first[1][i] = ends[1];
            self.change[0][i] = value + DISTANCE * left - ends[0];
            self.change[1][i] = value + DISTANCE * right - ends[1];
            // The difference from the line is largest at the center.
            let difference = corner.abs() + 2.0 * (left + right - corner).abs();
            let magnitude = magnitude + value.abs() + left.abs() + right.abs();
            self.margin[i] = margin(DISTANCE / 2.0 * difference, 6.0 * magnitude);
        }
    }

    /// Return the displacements of the first and the last pixel.
    #[inline(always)]
    fn ends(&self, time: f32) -> [Blocks<f32>; 2] {
        let mut ends = [[0.0; BLOCKS_PER_STEP]; 2];
        for end in 0..2 {
            for i in 0..BLOCKS_PER_STEP {
                ends[end][i] = self.first[end][i] + time * self.change[end][i];
            }
        }
        ends
    }

    /// Return the smallest and the largest shift of each block from the first to the last time.
    #[inline(always)]
    fn shifts(&self, times: [f32; 2]) -> [Blocks<i32>; 2] {
        let [[a, b], [c, d]] = [self.ends(times[0]), self.ends(times[1])];
        let mut shifts = [[0; BLOCKS_PER_STEP]; 2];
        for i in 0..BLOCKS_PER_STEP {
            let low = min(min(a[i], b[i]), min(c[i], d[i]));
            let high = max(max(a[i], b[i]), max(c[i], d[i]));
            shifts[0][i] = round(low - self.margin[i]);
            shifts[1][i] = round(high + self.margin[i]);
        }
        shifts
    }

    /// Return the part of each block that has the shift of its first pixel, and both shifts.
    #[inline(always)]
    fn split(&self, time: f32) -> Split {
        let [left, right] = self.ends(time);
        let (mut low, mut high) = ([0; BLOCKS_PER_STEP], [0; BLOCKS_PER_STEP]);
        for i in 0..BLOCKS_PER_STEP {
            low[i] = round(min(left[i], right[i]) - self.margin[i]);
            high[i] = round(max(left[i], right[i]) + self.margin[i]);
        }
        let mut split = Split {
            first: low,
            last: low,
            length: [BLOCK as i32; BLOCKS_PER_STEP],
            is_certain: [1; BLOCKS_PER_STEP],
        };
        if self.is_flat {
            for i in 0..BLOCKS_PER_STEP {
                split.is_certain[i] = i32::from(low[i] == high[i]);
            }
            return split;
        }
        for i in 0..BLOCKS_PER_STEP {
            let (left, right) = (left[i], right[i]);
            let (first, last) = (round(left), round(right));
            // The line crosses this boundary between two shifts, at this pixel.
            let boundary = 0.5 * (first + last) as f32;
            let pixels = (BLOCK - 1) as f32;
            let pixels_per_change = pixels / (right - left);
            let place = max(min((boundary - left) * pixels_per_change, pixels), 0.0);
            // If the place is a whole number, the distance is 0, and any rounding is right.
            let before = round(place - 0.5);
            let fraction = place - before as f32;
            // How far the next pixels are from the boundary.
            let distance = min(fraction, 1.0 - fraction);
            let is_next = (last - first).abs() == 1;
            let is_certain = is_next & (distance > self.margin[i] * pixels_per_change.abs());
            let is_constant = low[i] == high[i];
            split.first[i] = first;
            split.last[i] = last;
            split.length[i] = if is_constant {
                BLOCK as i32
            } else {
                before + 1
            };
            split.is_certain[i] = i32::from(is_constant | is_certain);
        }
        split
    }
}

/// The displacements of a block in one direction, which are nearly a linear function of the pixel.
pub(super) struct BlockLine {
    /// The first values of the first and the last pixel.
    pub first: [f32; 2],
    /// Their changes.
    pub change: [f32; 2],
    /// The maximum difference between a displacement and the line through the first and the last
    /// one, at any time from -2 to 2.
    pub difference: f32,
    /// A number that is not smaller than any number that was used.
    pub magnitude: f32,
}

impl BlockLine {
    /// Return the line through the first and the last of some displacements.
    #[inline(always)]
    pub fn through(first: &[f32; BLOCK], change: &[f32; BLOCK]) -> Self {
        let [first_ends, change_ends] =
            [first, change].map(|values| [values[0], values[BLOCK - 1]]);
        let slope_of_first = (first_ends[1] - first_ends[0]) / (BLOCK - 1) as f32;
        let slope_of_change = (change_ends[1] - change_ends[0]) / (BLOCK - 1) as f32;
        let mut differences = [0.0; BLOCK];
        for pixel in 0..BLOCK {
            let of_first = first[pixel] - (first_ends[0] + slope_of_first * PIXELS[pixel]);
            let of_change = change[pixel] - (change_ends[0] + slope_of_change * PIXELS[pixel]);
            differences[pixel] = of_first.abs() + 2.0 * of_change.abs();
        }
        Self {
            first: first_ends,
            change: change_ends,
            difference: fold(&fold_halves(&differences, &max), max),
            magnitude: first_ends[0].abs()
                + first_ends[1].abs()
                + 2.0 * (change_ends[0].abs() + change_ends[1].abs()),
        }
    }
}

/// Blocks with up to two shifts in one direction.
struct Split {
    first: Blocks<i32>,
    last: Blocks<i32>,
    /// The number of pixels with the first shift.
    length: Blocks<i32>,
    is_certain: Blocks<i32>,
}

/// Neighboring blocks whose shifts are searched together.
#[derive(Clone, Copy, Default)]
pub(super) struct Step {
    /// Their displacements in rows and columns.
    pub lines: [Lines; 2],
}

/// Blocks that are divided into two parts with one shift each.
pub(super) struct Parts {
    /// The shifts of the first part, in rows and columns.
    pub first: [Blocks<i32>; 2],
    /// The shifts of the second part.
    pub last: [Blocks<i32>; 2],
    /// The number of pixels of the first part.
    pub length: Blocks<i32>,
    /// 0 if a block may have other shifts.
    pub is_certain: Blocks<i32>,
}

impl Step {
    /// Return whether no block is divided into two parts.
    #[inline(always)]
    pub fn is_flat(&self) -> bool {
        self.lines[0].is_flat && self.lines[1].is_flat
    }

    /// Return the parts of all blocks.
    #[inline(always)]
    pub fn parts(&self, time: f32) -> Parts {
        let [rows, columns] = [self.lines[0].split(time), self.lines[1].split(time)];
        let mut parts = Parts {
            first: [rows.first, columns.first],
            last: [rows.last, columns.last],
            length: [0; BLOCKS_PER_STEP],
            is_certain: [0; BLOCKS_PER_STEP],
        };
        for i in 0..BLOCKS_PER_STEP {
            let [a, b] = [rows.length[i], columns.length[i]];
            let has_two = a == b || a == BLOCK as i32 || b == BLOCK as i32;
            parts.length[i] = a.min(b);
            parts.is_certain[i] = rows.is_certain[i] & columns.is_certain[i] & i32::from(has_two);
        }
        parts
    }

    /// Return the shift of each block at the first time, and 0 if it is the same for all pixels
    /// until the last time.
    #[inline(always)]
    pub fn common_shifts(&self, times: [f32; 2]) -> ([Blocks<i32>; 2], Blocks<i32>) {
        let [rows, columns] = [self.lines[0].shifts(times), self.lines[1].shifts(times)];
        let mut differences = [0; BLOCKS_PER_STEP];
        for i in 0..BLOCKS_PER_STEP {
            differences[i] = (rows[0][i] ^ rows[1][i]) | (columns[0][i] ^ columns[1][i]);
        }
        ([rows[0], columns[0]], differences)
    }
}
