//! The transform of sums of products into the output of a layer: depth-to-space rearrangement,
//! skip connection, and splines included.

use super::TILE;
use super::products::PRODUCTS;
use super::transforms::{DEPTH, transform_output};
use crate::cpu::Simd;
use crate::network::spline::evaluate::Spline;
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::StripedPlanes;
use crate::numbers::Real;

/// The operations of a layer after its convolution.
pub(crate) struct Finish<'a, F> {
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
    /// The distance between the first tiles of two rows of tiles in the registers.
    pub spacing: usize,
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

impl<F: Real> Finish<'_, F> {
    /// Return the lengths of the buffers.
    pub(super) fn lengths(&self, tiles: usize) -> (usize, usize, usize) {
        let plane = TILE * TILE * tiles;
        let planes = self.upsampling * self.upsampling;
        (plane, plane * planes, plane * planes)
    }

    /// Write the output of one filter. `sums` has the shape `(N, PRODUCTS)`, and its elements are
    /// registers.
    #[inline(always)]
    pub(super) fn write<S: Simd, const N: usize>(
        &self,
        simd: S,
        filter: usize,
        sums: &[F::Vector<S>],
        block: OutputBlock,
        buffers: &mut OutputBuffers<'_, F>,
        out: &mut [F],
    ) {
        transform_tiles::<S, F, N>(simd, sums, buffers.phases);
        let planes = self.upsampling * self.upsampling;
        let plane = buffers.phases.len();
        let deep = &mut buffers.deep[filter % planes * plane..][..plane];
        join_phases(buffers.phases, deep);
        if filter % planes < planes - 1 {
            return;
        }
        let columns = TILE * N * F::lanes::<S>();
        if planes > 1 {
            depth_to_space(buffers.deep, self.upsampling, columns, buffers.channel);
            self.write_channel(simd, filter / planes, block, columns, buffers.channel, out);
        } else {
            self.write_channel(simd, filter, block, columns, deep, out);
        }
    }

    /// Add the skip connection to a channel of a block, apply the spline, and write the result to
    /// its place. The rows of `values` belong to `columns` columns before the upsampling.
    #[inline(always)]
    fn write_channel<S: Simd>(
        &self,
        simd: S,
        channel: usize,
        block: OutputBlock,
        columns: usize,
        values: &mut [F],
        out: &mut [F],
    ) {
        let factor = self.upsampling;
        let (top, left) = (block.row * factor, block.column * factor);
        let (height, width) = (block.height * factor, block.width * factor);
        let row_length = columns * factor;
        // The index in `values` of the first value of a row of the block.
        let start = |row: usize| {
            let (tile_row, row) = (row / (TILE * factor), row % (TILE * factor));
            row * row_length + tile_row * block.spacing * TILE * factor
        };
        if let Some(skip) = self.skip {
            let first = self.region.columns.start + left - skip.columns.start;
            for row in 0..height {
                let skip = skip.row(self.region.rows.start + top + row);
                let skip = &skip.plane(channel)[first..][..width];
                for (value, &skip) in values[start(row)..][..width].iter_mut().zip(skip) {
                    *value += skip;
                }
            }
        }
        if let Some(spline) = self.splines.get(channel) {
            spline.apply_with(simd, values);
        }
        let plane = &mut out[channel * self.region.pixels()..][..self.region.pixels()];
        let rows = plane.chunks_exact_mut(self.region.columns.len()).skip(top);
        for (row, out) in rows.take(height).enumerate() {
            out[left..][..width].copy_from_slice(&values[start(row)..][..width]);
        }
    }
}

/// Transform `N` registers of tiles into `(TILE, TILE, N)` registers.
#[inline(always)]
fn transform_tiles<S: Simd, F: Real, const N: usize>(
    simd: S,
    sums: &[F::Vector<S>],
    phases: &mut [F],
) {
    let phases = F::vectors_mut::<S>(phases);
    let phases = &mut phases[..TILE * TILE * N];
    for (register, sums) in sums.as_chunks::<PRODUCTS>().0.iter().enumerate() {
        // Closures would not be compiled for the instruction set, so these are loops.
        let (products, _) = sums.as_chunks::<DEPTH>();
        let mut columns = [[F::splat(simd, F::zero()); DEPTH]; TILE];
        for row in 0..DEPTH {
            let values = transform_output::<S, F>(simd, products[row]);
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

/// Return the columns of each row to their order.
#[inline(always)]
fn join_phases<F: Real>(phases: &[F], rows: &mut [F]) {
    let length = phases.len() / TILE;
    for (phases, row) in phases
        .chunks_exact(length)
        .zip(rows.chunks_exact_mut(length))
    {
        let mut phases = phases.chunks_exact(length / TILE);
        let [a, b, c, d]: [&[F]; TILE] = std::array::from_fn(|_| phases.next().unwrap_or_default());
        let values = a.iter().zip(b).zip(c).zip(d);
        for (quad, (((a, b), c), d)) in row.as_chunks_mut::<TILE>().0.iter_mut().zip(values) {
            *quad = [*a, *b, *c, *d];
        }
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
