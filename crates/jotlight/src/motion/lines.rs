//! Displacements of blocks of pixels, searched for parts with one shift.

/// The number of neighboring pixels whose shifts are searched together.
pub const BLOCK: usize = 16;

/// The number of neighboring blocks whose shifts are searched together.
pub(super) const BLOCKS_PER_STEP: usize = 8;

/// A number for each block of a step.
pub(super) type Blocks<T> = [T; BLOCKS_PER_STEP];

/// The sum of a displacement and this number has the rounded displacement in its last bits, because
/// at this magnitude, the last bit of the mantissa is worth 1.
const UNIT_ULP: f32 = 12_582_912.0;

/// The numbers of the pixels of a block.
const PIXELS: [f32; BLOCK] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0,
];

/// Return x, rounded to the nearest whole number, for |x| < 2²². Halves become even numbers.
#[inline(always)]
pub(super) fn round(x: f32) -> i32 {
    let bits = (x + UNIT_ULP).to_bits();
    bits.wrapping_sub(UNIT_ULP.to_bits()).cast_signed()
}

/// Combine all values of a block.
#[inline(always)]
fn fold(values: &[f32; BLOCK], combine: impl Fn(f32, f32) -> f32) -> f32 {
    let values: [f32; 8] = fold_halves(values, &combine);
    let values: [f32; 4] = fold_halves(&values, &combine);
    let values: [f32; 2] = fold_halves(&values, &combine);
    combine(values[0], values[1])
}

/// Combine the first half of some values with the second one.
#[inline(always)]
fn fold_halves<const FROM: usize, const TO: usize>(
    values: &[f32; FROM],
    combine: &impl Fn(f32, f32) -> f32,
) -> [f32; TO] {
    let mut combined = [0.0; TO];
    for i in 0..TO {
        combined[i] = combine(values[i], values[TO + i]);
    }
    combined
}

/// Return the larger one of two numbers that are not NaN.
#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Return the smaller one of two numbers that are not NaN.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

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
}

impl Lines {
    /// Replace the line of a block.
    #[inline(always)]
    pub fn set(&mut self, block: usize, line: &BlockLine) {
        self.first[0][block] = line.first[0];
        self.first[1][block] = line.first[1];
        self.change[0][block] = line.change[0];
        self.change[1][block] = line.change[1];
        // Each of a few roundings causes an error of up to 2^-24 of the largest value.
        self.margin[block] = line.difference + 1e-6 * (2.0 + line.magnitude);
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
        if low == high {
            return split;
        }
        for i in 0..BLOCKS_PER_STEP {
            let (left, right) = (left[i], right[i]);
            let (first, last) = (round(left), round(right));
            // The line crosses this boundary between two shifts, at this pixel.
            let boundary = 0.5 * (first as f32 + last as f32);
            let pixels = (BLOCK - 1) as f32;
            let place = (boundary - left) / (right - left) * pixels;
            let is_between = place > 0.0 && place < pixels;
            let place = if is_between { place } else { 0.0 };
            let nearest = round(place);
            let before = nearest - i32::from(nearest as f32 > place);
            let fraction = place - before as f32;
            // How far the displacements of the next pixels are from the boundary.
            let distance = min(fraction, 1.0 - fraction) * (right - left).abs();
            let is_certain = (last - first).abs() == 1 && distance > pixels * self.margin[i];
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
    /// The means of the first values and of the changes.
    pub mean: [f32; 2],
}

impl BlockLine {
    /// Return the line through the first and the last of some displacements. The means are 0.
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
            difference: fold(&differences, max),
            magnitude: first_ends[0].abs()
                + first_ends[1].abs()
                + 2.0 * (change_ends[0].abs() + change_ends[1].abs()),
            mean: [0.0; 2],
        }
    }
}

/// Return the mean of the first `length` pixels.
#[inline(always)]
pub(super) fn mean(pixels: &[f32; BLOCK], length: usize) -> f32 {
    let sum = if length == BLOCK {
        fold(pixels, |a, b| a + b)
    } else {
        pixels[..length].iter().sum()
    };
    sum / length as f32
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

/// Bounds of the displacements of a row in one direction.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    /// The smallest and the largest first value, and the same of the changes.
    first: [f32; 2],
    change: [f32; 2],
    margin: f32,
}

impl Bounds {
    /// Return the bounds of the lines of a direction in some steps.
    #[inline(always)]
    pub fn new(steps: &[Step], direction: usize) -> Self {
        let mut low = [[f32::INFINITY; BLOCKS_PER_STEP]; 2];
        let mut high = [[f32::NEG_INFINITY; BLOCKS_PER_STEP]; 2];
        let mut margin = [0.0; BLOCKS_PER_STEP];
        for step in steps {
            let lines = &step.lines[direction];
            for (index, ends) in [lines.first, lines.change].into_iter().enumerate() {
                for i in 0..BLOCKS_PER_STEP {
                    low[index][i] = min(low[index][i], min(ends[0][i], ends[1][i]));
                    high[index][i] = max(high[index][i], max(ends[0][i], ends[1][i]));
                }
            }
            for i in 0..BLOCKS_PER_STEP {
                margin[i] = max(margin[i], lines.margin[i]);
            }
        }
        let lowest = |values: Blocks<f32>| values.into_iter().fold(f32::INFINITY, min);
        let highest = |values: Blocks<f32>| values.into_iter().fold(f32::NEG_INFINITY, max);
        Self {
            first: [lowest(low[0]), highest(high[0])],
            change: [lowest(low[1]), highest(high[1])],
            margin: highest(margin),
        }
    }

    /// Return the smallest and the largest shift from the first to the last time.
    #[inline(always)]
    pub fn shifts(&self, times: [f32; 2]) -> [i32; 2] {
        let [low, high] = self.change;
        let [a, b] = [times[0] * low, times[0] * high];
        let [c, d] = [times[1] * low, times[1] * high];
        let low = self.first[0] + min(min(a, b), min(c, d));
        let high = self.first[1] + max(max(a, b), max(c, d));
        // The margin of a block does not include errors from the sum of the bounds.
        [
            round(low - 2.0 * self.margin),
            round(high + 2.0 * self.margin),
        ]
    }
}
