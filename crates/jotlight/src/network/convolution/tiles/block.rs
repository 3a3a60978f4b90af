//! The convolution of a block of columns: its planes as pairs, the products, and the output.
//!
//! The planes of a block are copied to rows of pairs of inputs. The three copies are shifted by a
//! column, so no tile divides a cache line, which would take several times as long to load.

use super::{FILTER_SIZE, SIDE, TileFilters, TileUnit, pair_of};
use crate::border::mirror_index;
use crate::cpu::{self, Simd, WithSimd};
use crate::interrupt;
use crate::network::convolution::winograd::Finish;
use crate::network::tiling::interleave::interleave_inlined;
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::{LINE, PlaneRow, PlanesMut, StripedPlanes, line_start};
use crate::numbers::Real;

/// The number of columns of a block: those of two tiles.
const COLUMNS: usize = 2 * SIDE;
/// The number of rows whose sums become the output together, so that a spline is looked up for many
/// values.
const ROWS: usize = 4;

/// The buffers for a block.
#[derive(Default)]
pub(crate) struct TileWorkspace<F> {
    /// The pairs of inputs, `(3, rows, pairs, COLUMNS)`: copies, of which each begins one column
    /// later. Zeros follow.
    pairs: Vec<u32>,
    /// The sums of [`ROWS`] rows, `(outputs, ROWS, COLUMNS)`.
    sums: Vec<F>,
}

/// A block of columns of the output, counted from those of the region.
struct Block<'a, 'b, U, F, const ROUNDS: bool> {
    filters: &'a TileFilters,
    source: &'a StripedPlanes<'a, F>,
    output: &'a Region,
    finish: &'a Finish<'a, F, ROUNDS>,
    pairs: &'a mut [u32],
    sums: &'a mut [F],
    out: &'a mut PlanesMut<'b, F>,
    unit: U,
    column: usize,
    width: usize,
}

impl TileFilters {
    /// Convolve as [`TileFilters::convolve`] does, with the tiles `U`.
    pub(super) fn convolve_with<U: TileUnit, F: Real, const ROUNDS: bool>(
        &self,
        source: &StripedPlanes<'_, F>,
        output: &Region,
        finish: &Finish<'_, F, ROUNDS>,
        workspace: &mut TileWorkspace<F>,
        out: &mut PlanesMut<'_, F>,
    ) {
        let rows = (output.rows.len() + FILTER_SIZE - 1) * self.inputs.div_ceil(2);
        // The last chunk of pairs may exceed the last row.
        let length = (FILTER_SIZE * rows + SIDE) * COLUMNS;
        let sums_length = self.groups * self.shape.outputs * ROWS * COLUMNS;
        let TileWorkspace { pairs, sums } = workspace;
        pairs.resize(pairs.len().max(length + LINE), 0);
        sums.resize(sums.len().max(sums_length + LINE), F::zero());
        let (first, first_sum) = (line_start(pairs), line_start(sums));
        let pairs = &mut pairs[first..][..length];
        pairs[FILTER_SIZE * rows * COLUMNS..].fill(0);
        for column in (0..output.columns.len()).step_by(COLUMNS) {
            // The question may call other code, which may use tiles.
            if interrupt::is_requested() {
                return;
            }
            cpu::run(Block {
                filters: self,
                source,
                output,
                finish,
                pairs,
                sums: &mut sums[first_sum..][..sums_length],
                out,
                unit: U::configured(self.shape),
                column,
                width: COLUMNS.min(output.columns.len() - column),
            });
        }
    }
}

impl<U: TileUnit, F: Real, const ROUNDS: bool> WithSimd for Block<'_, '_, U, F, ROUNDS> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.pack();
        let height = self.output.rows.len();
        for row in (0..height).step_by(ROWS) {
            let rows = ROWS.min(height - row);
            if let Some(sums) = F::as_f32_slice(self.sums) {
                let unit = &mut self.unit;
                if self.filters.groups == 1 {
                    // Two rows fill the tiles of sums. After an odd number, the last one is repeated.
                    for first in (0..rows).step_by(2) {
                        let second = (first + 1).min(rows - 1);
                        let places = [(row + first, first), (row + second, second)];
                        multiply_rows(unit, self.filters, self.pairs, places, sums);
                    }
                } else {
                    for place in 0..rows {
                        for group in (0..self.filters.groups).step_by(2) {
                            let place = (row + place, place);
                            multiply_groups(unit, self.filters, self.pairs, (place, group), sums);
                        }
                    }
                }
            }
            for channel in 0..self.channels() {
                if self.finish.upsampling == 1 {
                    self.write(simd, channel, row, rows);
                } else {
                    self.write_upsampled(simd, channel, row, rows);
                }
            }
        }
    }
}

impl<U: TileUnit, F: Real, const ROUNDS: bool> Block<'_, '_, U, F, ROUNDS> {
    fn channels(&self) -> usize {
        self.filters.outputs / (self.finish.upsampling * self.finish.upsampling)
    }

    /// Copy the planes of the block to rows of pairs.
    #[inline(always)]
    fn pack(&mut self) {
        let (inputs, pairs) = (self.filters.inputs, self.filters.inputs.div_ceil(2));
        let rows = self.output.rows.len() + FILTER_SIZE - 1;
        let copy_length = rows * pairs * COLUMNS;
        for row in 0..rows {
            let source_row = (self.output.rows.start + row) as isize - 1;
            let source = self
                .source
                .row(mirror_index(source_row, self.source.size.0));
            for pair in 0..pairs {
                let second = (2 * pair + 1 < inputs).then_some(2 * pair + 1);
                let line = self.line(source, 2 * pair, second);
                let start = (row * pairs + pair) * COLUMNS;
                for copy in 0..FILTER_SIZE {
                    self.pairs[copy * copy_length + start..][..COLUMNS]
                        .copy_from_slice(&line[copy..][..COLUMNS]);
                }
            }
        }
    }

    /// Return a row of a pair of planes, from one column before the block to one after it.
    #[inline(always)]
    fn line(
        &self,
        row: PlaneRow<'_, F>,
        first: usize,
        second: Option<usize>,
    ) -> [u32; COLUMNS + FILTER_SIZE - 1] {
        let mut line = [0; COLUMNS + FILTER_SIZE - 1];
        let left = self.output.columns.start + self.column;
        let known = (self.source.columns.end - left).min(COLUMNS + 1);
        let before = usize::from(left > 0);
        let place = left - before - self.source.columns.start;
        let length = known + before;
        let to_f32 = |value: F| value.as_f64() as f32;
        let words = line[1 - before..][..length].iter_mut();
        let values = words.zip(&row.plane(first)[place..][..length]);
        match second {
            Some(second) => {
                let seconds = &row.plane(second)[place..][..length];
                for ((word, &first), &second) in values.zip(seconds) {
                    *word = pair_of(to_f32(first), to_f32(second));
                }
            }
            None => {
                for (word, &first) in values {
                    *word = pair_of(to_f32(first), 0.0);
                }
            }
        }
        // The planes continue symmetrically.
        if before == 0 {
            line[0] = line[1];
        }
        if known <= COLUMNS {
            line[1 + known] = line[known];
        }
        line
    }

    /// Write some rows of a channel.
    #[inline(always)]
    fn write<S: Simd>(&mut self, simd: S, channel: usize, row: usize, rows: usize) {
        let values = &mut self.sums[channel * ROWS * COLUMNS..][..rows * COLUMNS];
        for (place, values) in values.chunks_exact_mut(COLUMNS).enumerate() {
            let place = (row + place, self.column);
            self.finish
                .add_skip(channel, place, &mut values[..self.width]);
        }
        self.finish.activate(simd, channel, values);
        for (place, values) in values.chunks_exact(COLUMNS).enumerate() {
            let out = &mut self.out.row(channel, row + place)[self.column..];
            out[..self.width].copy_from_slice(&values[..self.width]);
        }
    }

    /// Write some rows of a channel after its upsampling.
    #[inline(always)]
    fn write_upsampled<S: Simd>(&mut self, simd: S, channel: usize, row: usize, rows: usize) {
        let factor = self.finish.upsampling;
        let (left, width) = (self.column * factor, self.width * factor);
        for out_row in row * factor..(row + rows) * factor {
            let place = out_row / factor - row;
            let first = (channel * factor + out_row % factor) * factor;
            let plane = |phase: usize| {
                let start = ((first + phase) * ROWS + place) * COLUMNS;
                &self.sums[start..][..self.width]
            };
            let out = &mut self.out.row(channel, out_row)[left..][..width];
            if factor == 2 {
                interleave_inlined(plane(0), plane(1), out);
            } else {
                for phase in 0..factor {
                    let pixels = out.iter_mut().skip(phase).step_by(factor);
                    for (out, &value) in pixels.zip(plane(phase)) {
                        *out = value;
                    }
                }
            }
            self.finish.add_skip(channel, (out_row, left), out);
            self.finish.activate(simd, channel, out);
        }
    }
}

/// Add up a row of the block for two groups of outputs. A place is a row of the region, and its index
/// among the sums.
#[inline(always)]
fn multiply_groups<U: TileUnit>(
    unit: &mut U,
    filters: &TileFilters,
    pairs: &[u32],
    ((row, place), group): ((usize, usize), usize),
    sums: &mut [f32],
) {
    let tile = filters.shape.outputs;
    clear_sums(unit);
    for step in 0..filters.chunks * FILTER_SIZE {
        let planes = planes_of(filters, pairs, row, step);
        let lines = &filters.lines[(step * filters.groups + group) * tile..];
        unit.load_planes::<6>(planes, COLUMNS);
        unit.load_filters::<4>(lines);
        unit.multiply::<0, 4, 6>();
        unit.load_planes::<7>(&planes[SIDE..], COLUMNS);
        unit.multiply::<1, 4, 7>();
        unit.load_filters::<5>(&lines[tile..]);
        unit.multiply::<2, 5, 6>();
        unit.multiply::<3, 5, 7>();
    }
    let length = filters.shape.outputs * ROWS * COLUMNS;
    let first = group * length + place * COLUMNS;
    store_sums(unit, [first, first + length], sums);
}

/// Add up two rows of the block for a single group of outputs.
#[inline(always)]
fn multiply_rows<U: TileUnit>(
    unit: &mut U,
    filters: &TileFilters,
    pairs: &[u32],
    [(row, place), (next_row, next_place)]: [(usize, usize); 2],
    sums: &mut [f32],
) {
    let tile = filters.shape.outputs;
    clear_sums(unit);
    for step in 0..filters.chunks * FILTER_SIZE {
        unit.load_filters::<4>(&filters.lines[step * tile..]);
        let planes = planes_of(filters, pairs, row, step);
        unit.load_planes::<6>(planes, COLUMNS);
        unit.multiply::<0, 4, 6>();
        unit.load_planes::<7>(&planes[SIDE..], COLUMNS);
        unit.multiply::<1, 4, 7>();
        let planes = planes_of(filters, pairs, next_row, step);
        unit.load_planes::<6>(planes, COLUMNS);
        unit.multiply::<2, 4, 6>();
        unit.load_planes::<7>(&planes[SIDE..], COLUMNS);
        unit.multiply::<3, 4, 7>();
    }
    store_sums(unit, [place * COLUMNS, next_place * COLUMNS], sums);
}

/// Set the four tiles of sums to 0.
#[inline(always)]
fn clear_sums<U: TileUnit>(unit: &mut U) {
    unit.zero::<0>();
    unit.zero::<1>();
    unit.zero::<2>();
    unit.zero::<3>();
}

/// Write the four tiles of sums: two from each of two places on, side by side.
#[inline(always)]
fn store_sums<U: TileUnit>(unit: &mut U, [first, second]: [usize; 2], sums: &mut [f32]) {
    unit.store::<0>(&mut sums[first..], ROWS * COLUMNS);
    unit.store::<1>(&mut sums[first + SIDE..], ROWS * COLUMNS);
    unit.store::<2>(&mut sums[second..], ROWS * COLUMNS);
    unit.store::<3>(&mut sums[second + SIDE..], ROWS * COLUMNS);
}

/// Return the pairs from those on that a step for a row of the region reads. A step is a chunk and a
/// column of the filter.
#[inline(always)]
fn planes_of<'a>(filters: &TileFilters, pairs: &'a [u32], row: usize, step: usize) -> &'a [u32] {
    let pairs_per_row = filters.inputs.div_ceil(2);
    let copy_length = (pairs.len() / COLUMNS - SIDE) / FILTER_SIZE;
    let (chunk, copy) = (step / FILTER_SIZE, step % FILTER_SIZE);
    let line = copy * copy_length + row * pairs_per_row + chunk * filters.shape.pairs;
    &pairs[line * COLUMNS..]
}
