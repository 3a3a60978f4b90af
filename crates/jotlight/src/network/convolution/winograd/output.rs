//! The transform of sums of products into the output of a layer: depth-to-space rearrangement,
//! skip connection, and splines included.

use std::ops::Range;

use super::TILE;
use super::transforms::{DEPTH, transform_output};
use crate::cpu::Simd;
use crate::lanes::MAX_LANES;
use crate::network::precision::round_all_inlined;
use crate::network::spline::evaluate::Spline;
use crate::network::tiling::interleave::interleave_inlined;
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::{PlanesMut, StripedPlanes};
use crate::numbers::Real;

/// The operations of a layer after its convolution.
///
/// The output is rounded to bfloat16 if `ROUNDS`. This is a constant, so the code for `f32` remains
/// as fast as without it.
pub(crate) struct Finish<'a, F, const ROUNDS: bool> {
    /// The factor of the depth-to-space rearrangement.
    pub upsampling: usize,
    pub skip: Option<&'a StripedPlanes<'a, F>>,
    /// One spline per channel, or none.
    pub splines: &'a [Spline<F>],
    /// The region of the layer's output.
    pub region: &'a Region,
}

/// The position of a block of tiles in the output of the convolution.
#[derive(Clone, Copy)]
pub(super) struct OutputBlock {
    /// The first row and column, counted from those of the region.
    pub row: usize,
    pub column: usize,
    pub height: usize,
    pub width: usize,
}

impl OutputBlock {
    /// Return the number of tiles.
    pub fn tiles(&self) -> usize {
        self.height.div_ceil(TILE) * self.width.div_ceil(TILE)
    }

    /// Return whether several rows of tiles fill the registers together. The tiles of a register
    /// then follow each other. Otherwise, they have the order of
    /// [`Lanes::deinterleave`](crate::lanes::Lanes::deinterleave).
    fn has_rows_of_tiles(&self) -> bool {
        self.height > TILE
    }
}

/// The buffers for the output of a block of `tiles` tiles.
pub(super) struct OutputBuffers<'a, F> {
    /// The output of one filter, `(TILE, TILE, tiles)`: its rows, with columns separated by their
    /// position in a tile.
    pub phases: &'a mut [F],
    /// The outputs of `upsampling`² filters, `(filters, TILE, TILE · tiles)`.
    pub deep: &'a mut [F],
    /// One channel of the layer.
    pub channel: &'a mut [F],
}

impl<F: Real, const ROUNDS: bool> Finish<'_, F, ROUNDS> {
    /// Return the lengths of the buffers.
    pub(super) fn lengths(&self, tiles: usize) -> (usize, usize, usize) {
        let plane = TILE * TILE * tiles;
        let planes = self.upsampling * self.upsampling;
        (plane, plane * planes, plane * planes)
    }

    /// Write the output of one filter. `sums` begins at the sums of the filter. Its shape is
    /// `(PRODUCTS, filters, N)` with a distance of `stride` registers between products, and its
    /// elements are registers.
    #[inline(always)]
    pub(super) fn write<S: Simd, const N: usize>(
        &self,
        simd: S,
        filter: usize,
        (sums, stride): (&[F::Vector<S>], usize),
        block: OutputBlock,
        buffers: &mut OutputBuffers<'_, F>,
        out: &mut PlanesMut<'_, F>,
    ) {
        transform_tiles::<S, F, N>(simd, (sums, stride), buffers.phases);
        if self.upsampling == 1 {
            return self.write_plane::<S, N>(simd, filter, block, buffers.phases, out);
        }
        let planes = self.upsampling * self.upsampling;
        let plane = buffers.phases.len();
        let deep = &mut buffers.deep[filter % planes * plane..][..plane];
        for (phases, deep) in buffers
            .phases
            .chunks_exact(plane / TILE)
            .zip(deep.chunks_exact_mut(plane / TILE))
        {
            if block.has_rows_of_tiles() {
                join_phases(phases, 0..plane / TILE / TILE, deep);
            } else {
                join_registers::<S, F, N>(simd, phases, deep);
            }
        }
        if filter % planes == planes - 1 {
            let columns = TILE * N * F::lanes::<S>();
            self.write_upsampled(simd, filter / planes, block, columns, buffers, out);
        }
    }

    /// Write a plane of a block. Its columns are separated by their position in a tile.
    #[inline(always)]
    fn write_plane<S: Simd, const N: usize>(
        &self,
        simd: S,
        channel: usize,
        block: OutputBlock,
        phases: &mut [F],
        out: &mut PlanesMut<'_, F>,
    ) {
        if self.skip.is_none() {
            self.activate(simd, channel, phases);
        }
        let row_length = phases.len() / TILE;
        let tiles = block.width.div_ceil(TILE);
        for row in 0..block.height {
            let phases = &phases[row % TILE * row_length..][..row_length];
            let out = &mut out.row_to_end(channel, block.row + row)[block.column..];
            if block.has_rows_of_tiles() {
                let first = row / TILE * tiles;
                join_phases(phases, first..first + tiles, out);
            } else {
                join_registers::<S, F, N>(simd, phases, &mut out[..tiles * TILE]);
            }
            if self.skip.is_some() {
                let out = &mut out[..block.width];
                self.add_skip(channel, (block.row + row, block.column), out);
                self.activate(simd, channel, out);
            }
        }
    }

    /// Add the skip connection to a part of a row of the layer's output. The part begins at a row and
    /// a column, counted from those of the region.
    #[inline(always)]
    pub(in crate::network::convolution) fn add_skip(
        &self,
        channel: usize,
        (row, column): (usize, usize),
        values: &mut [F],
    ) {
        if let Some(skip) = self.skip {
            let first = self.region.columns.start + column - skip.columns.start;
            let skip = skip.row(self.region.rows.start + row);
            for (value, &skip) in values.iter_mut().zip(&skip.plane(channel)[first..]) {
                *value += skip;
            }
        }
    }

    /// Apply the spline of a channel, and round the values if the layer does.
    #[inline(always)]
    pub(in crate::network::convolution) fn activate<S: Simd>(
        &self,
        simd: S,
        channel: usize,
        values: &mut [F],
    ) {
        if let Some(spline) = self.splines.get(channel) {
            spline.apply_with(simd, values);
        }
        if ROUNDS {
            round_all_inlined(values);
        }
    }

    /// Write a channel of a block after its upsampling. The rows of the buffers belong to `columns`
    /// columns before the upsampling.
    #[inline(always)]
    fn write_upsampled<S: Simd>(
        &self,
        simd: S,
        channel: usize,
        block: OutputBlock,
        columns: usize,
        buffers: &mut OutputBuffers<'_, F>,
        out: &mut PlanesMut<'_, F>,
    ) {
        let factor = self.upsampling;
        let width = block.width * factor;
        let tile_row_width = block.width.next_multiple_of(TILE) * factor;
        let (top, left) = (block.row * factor, block.column * factor);
        let is_double = factor == 2;
        if !is_double {
            depth_to_space(buffers.deep, factor, columns, buffers.channel);
        }
        for row in 0..block.height * factor {
            let (tile_row, tile_row_row) = (row / (TILE * factor), row % (TILE * factor));
            let first = tile_row * tile_row_width;
            let out = &mut out.row(channel, top + row)[left..][..width];
            if is_double {
                let start = tile_row_row / 2 * columns + first / 2;
                let phases = &buffers.deep[tile_row_row % 2 * 2 * TILE * columns + start..];
                let next = &phases[TILE * columns..];
                interleave_inlined(phases, next, out);
            } else {
                let start = tile_row_row * columns * factor + first;
                out.copy_from_slice(&buffers.channel[start..][..width]);
            }
            self.add_skip(channel, (top + row, left), out);
            self.activate(simd, channel, out);
        }
    }
}

/// Transform `N` registers of tiles into `(TILE, TILE, N)` registers.
#[inline(always)]
fn transform_tiles<S: Simd, F: Real, const N: usize>(
    simd: S,
    (sums, stride): (&[F::Vector<S>], usize),
    phases: &mut [F],
) {
    let phases = F::vectors_mut::<S>(phases);
    let phases = &mut phases[..TILE * TILE * N];
    for register in 0..N {
        // Closures would not be compiled for the instruction set, so these are loops.
        let mut columns = [[F::splat(simd, F::zero()); DEPTH]; TILE];
        for row in 0..DEPTH {
            let mut products = [F::splat(simd, F::zero()); DEPTH];
            for column in 0..DEPTH {
                products[column] = sums[(row * DEPTH + column) * stride + register];
            }
            let values = transform_output::<S, F>(simd, products);
            for column in 0..TILE {
                columns[column][row] = values[column];
            }
        }
        for column in 0..TILE {
            let values = transform_output::<S, F>(simd, columns[column]);
            for row in 0..TILE {
                phases[(row * TILE + column) * N + register] = values[row];
            }
        }
    }
}

/// Return the columns of a row of tiles to their order. The first registers of each column contain
/// the tiles in the order of `Lanes::deinterleave`.
#[inline(always)]
fn join_registers<S: Simd, F: Real, const N: usize>(simd: S, phases: &[F], row: &mut [F]) {
    let (phases, _) = F::vectors::<S>(phases).as_chunks::<N>();
    let [a, b, c, d] = [&phases[0], &phases[1], &phases[2], &phases[3]];
    let length = TILE * F::lanes::<S>();
    for (register, out) in row.chunks_mut(length).enumerate().take(N) {
        let values = [a[register], b[register], c[register], d[register]];
        let values = F::interleave(simd, values);
        if out.len() == length {
            F::vectors_mut::<S>(out)[..TILE].copy_from_slice(&values);
        } else {
            let mut whole = [F::zero(); TILE * MAX_LANES];
            F::vectors_mut::<S>(&mut whole)[..TILE].copy_from_slice(&values);
            out.copy_from_slice(&whole[..out.len()]);
        }
    }
}

/// Return the columns of the tiles `tiles` of a row to their order.
#[inline(always)]
fn join_phases<F: Real>(phases: &[F], tiles: Range<usize>, row: &mut [F]) {
    let length = phases.len() / TILE;
    let (a, rest) = phases.split_at(length);
    let (b, rest) = rest.split_at(length);
    let (c, d) = rest.split_at(length);
    let (a, b) = (&a[tiles.clone()], &b[tiles.clone()]);
    let (c, d) = (&c[tiles.clone()], &d[tiles]);
    let values = a.iter().zip(b).zip(c).zip(d);
    for (quad, (((a, b), c), d)) in row.as_chunks_mut::<TILE>().0.iter_mut().zip(values) {
        *quad = [*a, *b, *c, *d];
    }
}

/// Rearrange `factor`² planes of [`TILE`] rows into one plane with `factor` times as many rows and
/// columns.
#[inline(always)]
fn depth_to_space<F: Real>(deep: &[F], factor: usize, columns: usize, out: &mut [F]) {
    for (phase, deep) in deep.chunks_exact(TILE * columns).enumerate() {
        let rows = out.chunks_exact_mut(factor * columns);
        let rows = rows.skip(phase / factor).step_by(factor);
        for (deep, out) in deep.chunks_exact(columns).zip(rows) {
            let pixels = out.iter_mut().skip(phase % factor).step_by(factor);
            for (out, &value) in pixels.zip(deep) {
                *out = value;
            }
        }
    }
}
