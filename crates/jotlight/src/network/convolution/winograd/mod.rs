//! Convolution, equation (9), with 3 × 3 filters by Winograd's algorithm F(4 × 4, 3 × 3).
//!
//! A tile of 4 × 4 outputs needs 36 multiplications per filter instead of 144. The lanes of a
//! register hold tiles that lie side by side, so all transforms are arithmetic on whole registers.
//!
//! `transforms` holds the transforms along one axis. `input` transforms the planes, `products`
//! multiplies them with the filters, and `output` transforms the products into the output of the
//! layer.

mod input;
mod output;
mod products;
mod transforms;

use ndarray::ArrayView4;

use self::input::{InputBlock, InputBuffers};
pub(crate) use self::output::Finish;
use self::output::{OutputBlock, OutputBuffers};
use self::products::{PRODUCTS, TransformedFilters};
use crate::cpu::{self, Simd, WithSimd};
use crate::interrupt;
use crate::lanes::MAX_LANES;
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::{PlanesMut, StripedPlanes};
use crate::numbers::Real;

/// The number of rows and of columns of a filter.
const FILTER_SIZE: usize = 3;
/// The number of rows and of columns of a tile, whose outputs are computed together.
pub(crate) const TILE: usize = 4;
/// The multiplications as a share of those of direct convolution.
pub(crate) const SHARE: f64 = PRODUCTS as f64 / (TILE * TILE * FILTER_SIZE * FILTER_SIZE) as f64;

/// The minimum number of inputs. With fewer, the transforms take longer than the multiplications
/// that they save.
pub(super) const MIN_INPUTS: usize = 12;
/// The minimum number of outputs, for the same reason.
pub(super) const MIN_OUTPUTS: usize = 4;

/// The number of registers of tiles in a block. A block is transformed, multiplied, and written
/// while its values are in the cache.
const BLOCK_REGISTERS: usize = 2;

/// Filters for Winograd's algorithm.
#[derive(Clone, Debug)]
pub(crate) struct Winograd<F> {
    filters: TransformedFilters<F>,
}

impl<F: Real> Winograd<F> {
    /// Return the transformed filters `(outputs, inputs, rows, columns)`, or None where direct
    /// convolution is faster.
    pub fn new(filters: ArrayView4<'_, F>, stride: usize) -> Option<Self> {
        let (outputs, inputs, rows, columns) = filters.dim();
        let many = inputs >= MIN_INPUTS && outputs >= MIN_OUTPUTS;
        if (rows, columns) != (FILTER_SIZE, FILTER_SIZE) || stride != 1 || !many {
            return None;
        }
        Some(Self {
            filters: TransformedFilters::new(filters),
        })
    }

    /// Convolve for a region of the filters' output, and write the output of the layer into `out`.
    ///
    /// The first row and column of the region must be multiples of [`TILE`]. The rows of the source
    /// and of `out` must have the layout [`RowLayout`](crate::network::tiling::strips::RowLayout).
    pub fn convolve<const ROUNDS: bool>(
        &self,
        source: &StripedPlanes<'_, F>,
        output: &Region,
        finish: &Finish<'_, F, ROUNDS>,
        workspace: &mut Vec<F>,
        out: &mut PlanesMut<'_, F>,
    ) {
        cpu::run(Convolution {
            filters: &self.filters,
            source,
            output,
            finish,
            workspace,
            out,
        });
    }
}

/// The convolution for a region of the output.
struct Convolution<'a, 'b, F, const ROUNDS: bool> {
    filters: &'a TransformedFilters<F>,
    source: &'a StripedPlanes<'a, F>,
    output: &'a Region,
    finish: &'a Finish<'a, F, ROUNDS>,
    workspace: &'a mut Vec<F>,
    out: &'a mut PlanesMut<'b, F>,
}

impl<F: Real, const ROUNDS: bool> WithSimd for Convolution<'_, '_, F, ROUNDS> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (height, width) = (self.output.rows.len(), self.output.columns.len());
        let (lanes, tiles) = (F::lanes::<S>(), width.div_ceil(TILE));
        // Several rows of tiles of a narrow output share the registers.
        let tile_rows = (BLOCK_REGISTERS * lanes / tiles).clamp(1, height.div_ceil(TILE));
        let max_width = BLOCK_REGISTERS * lanes * TILE;
        for row in (0..height).step_by(TILE * tile_rows) {
            if interrupt::is_requested() {
                return;
            }
            for column in (0..width).step_by(max_width) {
                let block = OutputBlock {
                    row,
                    column,
                    height: (TILE * tile_rows).min(height - row),
                    width: max_width.min(width - column),
                };
                if block.tiles() <= lanes {
                    self.block::<S, 1>(simd, block);
                } else {
                    self.block::<S, BLOCK_REGISTERS>(simd, block);
                }
            }
        }
    }
}

impl<F: Real, const ROUNDS: bool> Convolution<'_, '_, F, ROUNDS> {
    /// Compute a block of `N` registers of tiles.
    #[inline(always)]
    fn block<S: Simd, const N: usize>(&mut self, simd: S, block: OutputBlock) {
        let (filters, lanes) = (self.filters, F::lanes::<S>());
        let tiles = N * lanes;
        // An odd number of registers between products distributes them over all sets of the cache.
        let stride = ((filters.inputs * N) | 1) * lanes;
        let sums_stride = ((filters.batch(tiles) * N) | 1) * lanes;
        let strides = (stride, sums_stride);
        let mut memory = Memory::aligned(self.workspace, strides, tiles, self.finish);
        let input = InputBlock {
            source: self.source,
            top: self.output.rows.start + block.row,
            left: self.output.columns.start + block.column,
            height: block.height,
            width: block.width,
        };
        let transformed = (&mut *memory.transformed, stride);
        input.transform::<S, N>(simd, filters.inputs, &mut memory.input, transformed);
        let batch = filters.batch(tiles);
        for first in (0..filters.outputs).step_by(batch) {
            let planes = (&*memory.transformed, &mut *memory.sums);
            filters.multiply::<S, N>(simd, first, planes, strides);
            let sums = F::vectors::<S>(memory.sums);
            for filter in first..(first + batch).min(filters.outputs) {
                let sums = (&sums[(filter - first) * N..], sums_stride / lanes);
                let buffers = &mut memory.output;
                let out = &mut *self.out;
                self.finish
                    .write::<S, N>(simd, filter, sums, block, buffers, out);
            }
        }
    }
}

/// The buffers for a block.
struct Memory<'a, F> {
    transformed: &'a mut [F],
    sums: &'a mut [F],
    input: InputBuffers<'a, F>,
    output: OutputBuffers<'a, F>,
}

impl<'a, F: Real> Memory<'a, F> {
    /// Return buffers for `tiles` tiles. Each begins at a cache line, because a register that two
    /// cache lines share takes twice as long to read.
    fn aligned<const ROUNDS: bool>(
        workspace: &'a mut Vec<F>,
        strides: (usize, usize),
        tiles: usize,
        finish: &Finish<'_, F, ROUNDS>,
    ) -> Self {
        let (rows, columns) = InputBuffers::<F>::lengths(tiles);
        let (phases, deep, channel) = finish.lengths(tiles);
        let lengths = [
            PRODUCTS * strides.0,
            PRODUCTS * strides.1,
            rows,
            columns,
            phases,
            deep,
            channel,
        ];
        let whole_lines = lengths.map(|length| length.next_multiple_of(CACHE_LINE));
        let length = whole_lines.iter().sum::<usize>() + CACHE_LINE;
        if workspace.len() < length {
            workspace.resize(length, F::zero());
        }
        let offset = workspace.as_ptr().align_offset(CACHE_LINE * size_of::<F>());
        let mut rest = &mut workspace[offset.min(CACHE_LINE)..];
        let [transformed, sums, rows, columns, phases, deep, channel] = lengths.map(|length| {
            let (part, others) =
                std::mem::take(&mut rest).split_at_mut(length.next_multiple_of(CACHE_LINE));
            rest = others;
            &mut part[..length]
        });
        Self {
            transformed,
            sums,
            input: InputBuffers { rows, columns },
            output: OutputBuffers {
                phases,
                deep,
                channel,
            },
        }
    }
}

/// The number of values to which buffers are aligned: a cache line of `f32`.
const CACHE_LINE: usize = MAX_LANES;

#[cfg(test)]
mod tests {
    use ndarray::{Array3, Array4, s};

    use super::*;
    use crate::border::mirror_index;
    use crate::network::tiling::strips::{RowLayout, Strip};

    /// Return pseudorandom values in \[−0.5, 0.6\] from a linear congruential generator.
    fn random(length: usize) -> Vec<f32> {
        let next = |state: &u32| Some(state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        let states = std::iter::successors(Some(1u32), next);
        states
            .map(|state| state as f32 / 4e9 - 0.5)
            .take(length)
            .collect()
    }

    fn convolved(winograd: &Winograd<f32>, planes: &Array3<f32>, output: &Region) -> Array3<f32> {
        let (inputs, height, width) = planes.dim();
        let filled = |region: &Region, channels: usize| {
            let layout = RowLayout::new(region.columns.clone(), channels);
            let data = vec![f32::NAN; layout.length(region.rows.len())];
            let rows = region.rows.clone();
            (layout, Strip { rows, data })
        };
        let (layout, mut strip) = filled(&Region::whole((height, width)), inputs);
        let mut source = layout.planes_mut(&mut strip);
        for ((plane, row, column), &value) in planes.indexed_iter() {
            source.row(plane, row)[column] = value;
        }
        let strips = [strip];
        let source = StripedPlanes::new(&strips, &layout, (height, width));
        let finish = Finish::<'_, _, false> {
            upsampling: 1,
            skip: None,
            splines: &[],
            region: output,
        };
        let outputs = winograd.filters.outputs;
        let (layout, mut strip) = filled(output, outputs);
        let mut out = layout.planes_mut(&mut strip);
        winograd.convolve(&source, output, &finish, &mut Vec::new(), &mut out);
        let shape = (outputs, output.rows.len(), output.columns.len());
        Array3::from_shape_fn(shape, |(plane, row, column)| out.row(plane, row)[column])
    }

    /// Return the sum of products at one pixel of an output.
    fn sum_of_products(
        planes: &Array3<f32>,
        filters: &Array4<f32>,
        (output, row, column): (usize, usize, usize),
    ) -> f64 {
        let (_, inputs, rows, columns) = filters.dim();
        let (_, height, width) = planes.dim();
        let mut sum = 0.0;
        for input in 0..inputs {
            for tap_row in 0..rows {
                for tap_column in 0..columns {
                    let y = mirror_index((row + tap_row) as isize - 1, height);
                    let x = mirror_index((column + tap_column) as isize - 1, width);
                    let value = planes[[input, y, x]];
                    let tap = [output, input, rows - 1 - tap_row, columns - 1 - tap_column];
                    sum += f64::from(value) * f64::from(filters[tap]);
                }
            }
        }
        sum
    }

    #[test]
    fn results_are_sums_of_products_and_do_not_depend_on_the_region()
    -> Result<(), Box<dyn std::error::Error>> {
        for (height, width) in [(1, 1), (2, 17), (3, 5), (9, 40), (13, 230)] {
            for (outputs, inputs) in [(4, 12), (5, 16), (24, 17), (26, 24)] {
                let planes = random(inputs * height * width);
                let planes = Array3::from_shape_vec((inputs, height, width), planes)?;
                let shape = (outputs, inputs, FILTER_SIZE, FILTER_SIZE);
                // Outputs of order 1, as in trained networks.
                let scale = 2.0 / (inputs as f32).sqrt() / FILTER_SIZE as f32;
                let filters = random(outputs * inputs * FILTER_SIZE * FILTER_SIZE);
                let filters = filters.into_iter().map(|tap| scale * tap).collect();
                let filters = Array4::from_shape_vec(shape, filters)?;
                let winograd = Winograd::new(filters.view(), 1).ok_or("expected Winograd")?;
                let all = convolved(&winograd, &planes, &Region::whole((height, width)));

                for (index, &value) in all.indexed_iter() {
                    let expected = sum_of_products(&planes, &filters, index);
                    assert!((f64::from(value) - expected).abs() < 1e-5);
                }

                let aligned = |index: usize| index / TILE * TILE;
                let end = aligned(width.div_ceil(2)).max(aligned(width / 3) + TILE);
                let part = Region {
                    rows: aligned(height / 2)..height,
                    columns: aligned(width / 3)..end.min(width),
                };
                let found = convolved(&winograd, &planes, &part);
                let expected = all.slice(s![.., part.rows.clone(), part.columns.clone()]);
                assert!(expected.iter().eq(found.iter()));
            }
        }
        Ok(())
    }

    #[test]
    fn unsuitable_filters_have_no_winograd_transform() {
        for (outputs, inputs, rows, columns, stride) in [
            (MIN_OUTPUTS, MIN_INPUTS, 5, 3, 1),
            (MIN_OUTPUTS, MIN_INPUTS, 3, 1, 1),
            (MIN_OUTPUTS, MIN_INPUTS - 1, 3, 3, 1),
            (MIN_OUTPUTS - 1, MIN_INPUTS, 3, 3, 1),
            (MIN_OUTPUTS, MIN_INPUTS, 3, 3, 2),
        ] {
            let filters = Array4::<f32>::zeros((outputs, inputs, rows, columns));
            assert!(Winograd::new(filters.view(), stride).is_none());
        }
    }
}
