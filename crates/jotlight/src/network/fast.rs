//! Banks of filters of three lines in half the multiplications: four rows at a time, in six sums of them (Winograd's F(4, 3), along
//! columns alone, whose sums need no shuffling of registers).

use ndarray::{ArrayView4, Axis};

use super::Real;
use super::bank::Bank;
use super::correlate::Planes;
use super::lsi::before;
use super::place::{Part, Place, Row};
use crate::cpu::{self, LANES, Simd, WithSimd};
use crate::sensing::mirror_index as mirrored;

/// Lines of a filter, rows that are found at a time, and sums that they are found from.
pub(super) const LINES: usize = 3;
pub(super) const ROWS: usize = 4;
const SUMS: usize = 6;

/// Inputs and outputs from which on what is saved is more than what the sums cost.
const INPUTS: usize = 16;
const OUTPUTS: usize = 4;
/// Columns at a time, so that the sums of all planes stay near the core.
const STRETCH: usize = 144;
/// Numbers in a row of sums: loops read whole registers past the end.
const STRIDE: usize = STRETCH + 2 * LANES;

/// What the lines of a filter are weighed by in each sum.
const OF_LINES: [[f64; LINES]; SUMS] = [
    [1.0 / 4.0, 0.0, 0.0],
    [-1.0 / 6.0, -1.0 / 6.0, -1.0 / 6.0],
    [-1.0 / 6.0, 1.0 / 6.0, -1.0 / 6.0],
    [1.0 / 24.0, 1.0 / 12.0, 1.0 / 6.0],
    [1.0 / 24.0, -1.0 / 12.0, 1.0 / 6.0],
    [0.0, 0.0, 1.0],
];

/// A bank of filters of one line for each of the sums.
#[derive(Clone, Debug)]
pub(super) struct Fast<F> {
    banks: Vec<Bank<F>>,
    inputs: usize,
    outputs: usize,
    columns: usize,
}

impl<F: Real> Fast<F> {
    /// Of filters `(outputs, inputs, lines, columns)`, if it is worth it.
    pub fn new(filters: ArrayView4<'_, F>, stride: usize) -> Option<Self> {
        let (outputs, inputs, lines, columns) = filters.dim();
        let many = inputs >= INPUTS && outputs >= OUTPUTS;
        if lines != LINES || columns > LANES || stride != 1 || !many {
            return None;
        }
        // Turned around, so that loops run forward.
        let weighed = filters.lanes(Axis(2)).into_iter().map(|tap| {
            OF_LINES.map(|weights| {
                let lines = tap.iter().rev().zip(weights);
                F::from_f64(lines.map(|(tap, weight)| tap.as_f64() * weight).sum())
            })
        });
        let weighed: Vec<_> = weighed.collect();
        let bank = |sum: usize| {
            Bank::new((outputs, inputs, 1, columns), |output, input, _, column| {
                weighed[(output * inputs + input) * columns + columns - 1 - column][sum]
            })
        };
        Some(Self {
            banks: (0..SUMS).map(bank).collect(),
            inputs,
            outputs,
            columns,
        })
    }

    /// h * u of a part of the output, `(outputs, height, width)`, whose first row is a multiple of [`ROWS`], in `room` for the sums.
    pub fn correlate(
        &self,
        source: &Part<'_, F>,
        wanted: &Place,
        room: &mut Vec<F>,
        out: &mut [F],
    ) {
        let of_inputs = self.inputs * STRIDE;
        let length = SUMS * (of_inputs + self.outputs * STRETCH);
        room.resize(room.len().max(length), F::zero());
        let (sums, products) = room.split_at_mut(SUMS * of_inputs);
        let (height, width) = (wanted.rows.len(), wanted.columns.len());
        let first = |place: usize, taps: usize| place as isize - before(taps, 1) as isize;
        let top = first(wanted.rows.start, LINES);
        let left = first(wanted.columns.start, self.columns);
        for row in (0..height).step_by(ROWS) {
            for column in (0..width).step_by(STRETCH) {
                let length = STRETCH.min(width - column);
                cpu::run(Gather {
                    source,
                    top: top + row as isize,
                    rows: SUMS.min(height - row + LINES - 1),
                    left: left + column as isize,
                    length: length + self.columns - 1,
                    sums,
                });
                // In whole registers.
                let wide = length.next_multiple_of(LANES);
                let products = &mut products[..SUMS * self.outputs * wide];
                let parts = products.chunks_exact_mut(self.outputs * wide);
                let parts = parts.zip(sums.chunks_exact(of_inputs));
                for (bank, (products, sums)) in self.banks.iter().zip(parts) {
                    let planes = Planes {
                        data: sums,
                        plane: STRIDE,
                        stride: STRIDE,
                    };
                    bank.correlate(planes, (1, wide), products);
                }
                cpu::run(Spread {
                    products,
                    wide,
                    place: (row, column),
                    length,
                    size: (height, width),
                    out,
                });
            }
        }
    }
}

/// The sums of six rows of every plane from a place on, `(sums, planes, STRIDE)`. Past the last row of all that is needed it takes 0.
struct Gather<'a, F> {
    source: &'a Part<'a, F>,
    top: isize,
    rows: usize,
    left: isize,
    length: usize,
    sums: &'a mut [F],
}

impl<F: Real> WithSimd for Gather<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Part { columns, size, .. } = self.source;
        let lanes = F::lanes::<S>();
        let length = self.length.next_multiple_of(lanes);
        let width = columns.len();
        let start = self.left - columns.start as isize;
        let lines: [_; SUMS] = std::array::from_fn(|row| {
            let row = row.min(self.rows - 1) as isize;
            self.source.row(mirrored(self.top + row, size.0))
        });
        // The columns that need no mirroring.
        let known = (-start).max(0) as usize..self.length.min((width as isize - start) as usize);
        let of_sum = self.sums.len() / SUMS;
        let inputs = of_sum / STRIDE;
        // Loops read whole registers, where they can without leaving the strip.
        let room = |line: &Row<'_, F>| line.of(inputs - 1).len() >= start.max(0) as usize + length;
        let whole = known == (0..self.length) && self.rows == SUMS && lines.iter().all(room);
        let mut copies = [[F::zero(); STRIDE]; SUMS];
        for input in 0..inputs {
            let rows: [&[F]; SUMS] = if whole {
                lines.map(|line| &line.of(input)[start as usize..][..length])
            } else {
                for (copy, line) in copies.iter_mut().zip(lines).take(self.rows) {
                    let line = line.of(input);
                    let from = (start + known.start as isize) as usize;
                    copy[known.clone()].copy_from_slice(&line[from..][..known.len()]);
                    for column in (0..known.start).chain(known.end..self.length) {
                        let source = mirrored(self.left + column as isize, size.1);
                        copy[column] = line[source - columns.start];
                    }
                }
                std::array::from_fn(|row| &copies[row][..length])
            };
            let rows = rows.map(F::vectors::<S>);
            let mut parts = self.sums.chunks_exact_mut(of_sum);
            let sums: [_; SUMS] = std::array::from_fn(|_| {
                let part = parts.next().unwrap_or_default();
                F::vectors_mut::<S>(&mut part[input * STRIDE..][..length])
            });
            for column in 0..length / lanes {
                // Not by iterators of arrays: what is not inlined goes through memory.
                let found = gathered::<S, F>(simd, std::array::from_fn(|row| rows[row][column]));
                for sum in 0..SUMS {
                    sums[sum][column] = found[sum];
                }
            }
        }
    }
}

/// The six sums of six rows.
#[inline(always)]
fn gathered<S: Simd, F: Real>(
    simd: S,
    [a, b, c, d, e, f]: [F::Vector<S>; SUMS],
) -> [F::Vector<S>; SUMS] {
    let add = |number, x, y| F::multiply_add(simd, F::splat(simd, F::from_f64(number)), x, y);
    let (even, odd) = (add(-4.0, c, e), add(-4.0, b, d));
    let (near, far) = (add(-1.0, c, e), add(-1.0, b, d));
    [
        add(4.0, a, add(-5.0, c, e)),
        add(1.0, odd, even),
        add(-1.0, odd, even),
        add(2.0, far, near),
        add(-2.0, far, near),
        add(4.0, b, add(-5.0, d, f)),
    ]
}

/// Four rows of six sums.
#[inline(always)]
fn spread<S: Simd, F: Real>(
    simd: S,
    [a, b, c, d, e, f]: [F::Vector<S>; SUMS],
) -> [F::Vector<S>; ROWS] {
    let add = |number, x, y| F::multiply_add(simd, F::splat(simd, F::from_f64(number)), x, y);
    let (near, far) = (add(1.0, c, b), add(1.0, e, d));
    let (tilt, lean) = (add(-1.0, c, b), add(-1.0, e, d));
    [
        add(1.0, near, add(1.0, far, a)),
        add(2.0, lean, tilt),
        add(4.0, far, near),
        add(8.0, lean, add(1.0, tilt, f)),
    ]
}

/// From the filtered sums `(sums, outputs, wide)` to four rows of the outputs.
struct Spread<'a, F> {
    products: &'a [F],
    wide: usize,
    place: (usize, usize),
    /// Columns that are wanted.
    length: usize,
    size: (usize, usize),
    out: &'a mut [F],
}

impl<F: Real> WithSimd for Spread<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { wide, length, .. } = self;
        let (height, width) = self.size;
        let lanes = F::lanes::<S>();
        let planes = self.out.chunks_exact_mut(height * width);
        for (output, plane) in planes.enumerate() {
            let mut parts = self.products.chunks_exact(self.products.len() / SUMS);
            let products: [_; SUMS] = std::array::from_fn(|_| {
                let part = parts.next().unwrap_or_default();
                F::vectors::<S>(&part[output * wide..][..wide])
            });
            let rows = plane.chunks_exact_mut(width).skip(self.place.0);
            let rows: [_; ROWS] = {
                let mut rows = rows.map(|row| &mut row[self.place.1..][..length]);
                std::array::from_fn(|_| rows.next().unwrap_or_default())
            };
            for column in 0..length.div_ceil(lanes) {
                let found = spread::<S, F>(simd, std::array::from_fn(|sum| products[sum][column]));
                for row in 0..ROWS {
                    let (found, row) = (found[row], &mut *rows[row]);
                    let first = column * lanes;
                    let last = (first + lanes).min(row.len());
                    if first + lanes <= row.len() {
                        F::vectors_mut::<S>(&mut row[first..last])[0] = found;
                    } else if first < last {
                        // What is left is shorter than a register.
                        let mut whole = [F::zero(); LANES];
                        F::vectors_mut::<S>(&mut whole)[0] = found;
                        row[first..last].copy_from_slice(&whole[..last - first]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, Array4};

    use super::*;

    /// Numbers without a pattern, from a linear congruence.
    fn some(length: usize) -> Vec<f32> {
        let next = |state: &u32| Some(state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        let states = std::iter::successors(Some(1u32), next);
        states
            .map(|state| state as f32 / 4e9 - 0.5)
            .take(length)
            .collect()
    }

    fn found(fast: &Fast<f32>, planes: &[f32], size: (usize, usize), wanted: &Place) -> Vec<f32> {
        let whole = Place {
            rows: 0..size.0,
            columns: 0..size.1,
        };
        let source = Part::whole(planes, whole, size);
        let mut out = vec![f32::NAN; fast.outputs * wanted.pixels()];
        fast.correlate(&source, wanted, &mut Vec::new(), &mut out);
        out
    }

    #[test]
    fn it_gives_the_sums_of_products_and_the_same_bits_for_every_part()
    -> Result<(), Box<dyn std::error::Error>> {
        for (height, width) in [(1, 1), (2, 17), (9, 40), (13, 230)] {
            for columns in [1, 2, 3, 6] {
                let (outputs, inputs) = (5, INPUTS);
                let planes = some(inputs * height * width);
                let shape = (outputs, inputs, LINES, columns);
                let filters = some(outputs * inputs * LINES * columns);
                let filters = Array4::from_shape_vec(shape, filters)?;
                let fast = Fast::new(filters.view(), 1).ok_or("not for these")?;
                let whole = Place {
                    rows: 0..height,
                    columns: 0..width,
                };
                let all = found(&fast, &planes, (height, width), &whole);
                let all = Array3::from_shape_vec((outputs, height, width), all)?;

                for ((output, row, column), &value) in all.indexed_iter() {
                    let mut sum = 0.0;
                    for input in 0..inputs {
                        for line in 0..LINES {
                            for tap in 0..columns {
                                let y = mirrored((row + line) as isize - 1, height);
                                let before = before(columns, 1) as isize;
                                let x = mirrored((column + tap) as isize - before, width);
                                let place = (input * height + y) * width + x;
                                let tap = [output, input, LINES - 1 - line, columns - 1 - tap];
                                sum += f64::from(planes[place]) * f64::from(filters[tap]);
                            }
                        }
                    }
                    assert!((f64::from(value) - sum).abs() < 1e-5);
                }

                let part = Place {
                    rows: height / 2 / ROWS * ROWS..height,
                    columns: width / 3..width.div_ceil(2),
                };
                let some = found(&fast, &planes, (height, width), &part);
                let expected = all.slice(ndarray::s![.., part.rows.clone(), part.columns.clone()]);
                assert!(expected.iter().eq(some.iter()));
            }
        }
        Ok(())
    }

    #[test]
    fn filters_that_it_is_not_for_are_left_to_others() {
        for (outputs, inputs, lines, stride) in [
            (OUTPUTS, INPUTS, 5, 1),
            (OUTPUTS, INPUTS - 1, 3, 1),
            (OUTPUTS - 1, INPUTS, 3, 1),
            (OUTPUTS, INPUTS, 3, 2),
        ] {
            let filters = Array4::<f32>::zeros((outputs, inputs, lines, 3));
            assert!(Fast::new(filters.view(), stride).is_none());
        }
    }
}
