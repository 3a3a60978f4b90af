//! The transform of the input of a block of tiles.

use std::ops::Range;

use super::transforms::{DEPTH, transform_input};
use super::{BLOCK_REGISTERS, TILE};
use crate::cpu::Simd;
use crate::network::tiling::strips::{PlaneRow, StripedPlanes};
use crate::numbers::{MAX_LANES, Real};
use crate::sensing::mirror_index;

/// The rows and columns of the input of a block: rows of tiles, one below the other.
pub(super) struct InputBlock<'a, F> {
    pub source: &'a StripedPlanes<'a, F>,
    /// The first row and column of the block's output.
    pub top: usize,
    pub left: usize,
    /// The numbers of output rows and columns.
    pub height: usize,
    pub width: usize,
    /// The distance between the first tiles of two rows of tiles in the registers.
    pub spacing: usize,
}

/// The buffers for the transform of one plane.
pub(super) struct InputBuffers<'a, F> {
    /// Rows after the transform along columns, `(DEPTH, width)`.
    pub rows: &'a mut [F],
    /// The same rows with the columns in the order `(DEPTH, TILE, tiles)`.
    pub phases: &'a mut [F],
}

/// The number of values that follow a row of the buffers, because some registers begin one tile to
/// the right.
const SPARE: usize = MAX_LANES;
/// The maximum number of rows of tiles in a block. A row has at least one tile and a separator.
const MAX_TILE_ROWS: usize = BLOCK_REGISTERS * MAX_LANES / 2;
/// The maximum number of columns that a block reads.
const MAX_COLUMNS: usize = TILE * BLOCK_REGISTERS * MAX_LANES + 2;

impl<F: Real> InputBuffers<'_, F> {
    /// Return the lengths of the buffers for a block of `tiles` tiles.
    pub const fn lengths(tiles: usize) -> (usize, usize) {
        (
            DEPTH * (TILE * tiles + SPARE),
            DEPTH * TILE * (tiles + SPARE),
        )
    }
}

impl<F: Real> InputBlock<'_, F> {
    /// Write the transform of a plane into `transformed`. Its shape is `(PRODUCTS, inputs, N)` with
    /// a distance of `stride` values between products, and its elements are registers.
    #[inline(always)]
    pub fn transform<S: Simd, const N: usize>(
        &self,
        simd: S,
        inputs: usize,
        buffers: &mut InputBuffers<'_, F>,
        (transformed, stride): (&mut [F], usize),
    ) {
        // The rows that the output does not depend on are 0. Then the result does not depend on
        // the strips that are in memory.
        let mut rows = [[None; DEPTH]; MAX_TILE_ROWS];
        for (tile_row, rows) in rows.iter_mut().enumerate() {
            for (row, source) in rows.iter_mut().enumerate() {
                let row = TILE * tile_row + row;
                if row < self.height + 2 {
                    let row = (self.top + row) as isize - 1;
                    *source = Some(self.source.row(mirror_index(row, self.source.size.0)));
                }
            }
        }
        let rows = &rows[..self.height.div_ceil(TILE)];
        let zeros = [F::zero(); MAX_COLUMNS];
        for input in 0..inputs {
            for (tile_row, &rows) in rows.iter().enumerate() {
                self.transform_columns(simd, rows, input, &zeros, buffers);
                let tiles = tile_row * self.spacing..(tile_row + 1) * self.spacing;
                separate_phases::<F>(buffers.rows, buffers.phases, N * F::lanes::<S>(), tiles);
            }
            let vectors = F::vectors_mut::<S>(transformed);
            let stride = stride / F::lanes::<S>();
            transform_rows::<S, F, N>(simd, buffers.phases, &mut vectors[input * N..], stride);
        }
    }

    /// Transform a plane along its columns. The first column of the result is `left` − 1.
    #[inline(always)]
    fn transform_columns<S: Simd>(
        &self,
        simd: S,
        rows: [Option<PlaneRow<'_, F>>; DEPTH],
        plane: usize,
        zeros: &[F],
        buffers: &mut InputBuffers<'_, F>,
    ) {
        let columns = &self.source.columns;
        // The columns of the buffers that lie in the source.
        let from = (columns.start + 1).saturating_sub(self.left);
        let to = (self.width + 2).min(columns.end + 1 - self.left);
        let first = self.left + from - 1 - columns.start;
        let sources = rows.map(|row| match row {
            Some(row) => &row.plane(plane)[first..][..to - from],
            None => &zeros[..to - from],
        });
        let row_length = buffers.rows.len() / DEPTH;
        let mut outputs = buffers.rows.chunks_exact_mut(row_length);
        let mut outputs: [&mut [F]; DEPTH] =
            std::array::from_fn(|_| outputs.next().unwrap_or_default());
        transform_slices(
            simd,
            sources,
            outputs.each_mut().map(|row| &mut row[from..to]),
        );
        for row in &mut outputs {
            for column in (0..from).chain(to..self.width + 2) {
                let source = (self.left + column) as isize - 1;
                row[column] = row[mirror_index(source, self.source.size.1) + 1 - self.left];
            }
            // The last tile may be wider than the output.
            row[self.width + 2..self.width.next_multiple_of(TILE) + 2].fill(F::zero());
        }
    }
}

/// Transform rows along their columns.
#[inline(always)]
fn transform_slices<S: Simd, F: Real>(simd: S, rows: [&[F]; DEPTH], out: [&mut [F]; DEPTH]) {
    let (lanes, length) = (F::lanes::<S>(), rows[0].len());
    if length < lanes {
        let mut padded = [[F::zero(); MAX_LANES]; DEPTH];
        for (padded, row) in padded.iter_mut().zip(rows) {
            padded[..length].copy_from_slice(row);
        }
        let mut values = [F::splat(simd, F::zero()); DEPTH];
        for (value, row) in values.iter_mut().zip(&padded) {
            *value = F::vectors::<S>(row)[0];
        }
        let values = transform_input::<S, F>(simd, values);
        for ((padded, value), out) in padded.iter_mut().zip(values).zip(out) {
            F::vectors_mut::<S>(padded)[0] = value;
            out.copy_from_slice(&padded[..length]);
        }
        return;
    }
    let mut start = 0;
    loop {
        let mut values = [F::splat(simd, F::zero()); DEPTH];
        for row in 0..DEPTH {
            values[row] = F::vectors::<S>(&rows[row][start..start + lanes])[0];
        }
        values = transform_input::<S, F>(simd, values);
        for row in 0..DEPTH {
            F::vectors_mut::<S>(&mut out[row][start..start + lanes])[0] = values[row];
        }
        if start + lanes == length {
            return;
        }
        // The last register overlaps the one before, so none extends beyond the end.
        start = (start + lanes).min(length - lanes);
    }
}

/// Write every [`TILE`]-th column of each row to a contiguous row, for each of the first columns.
///
/// `capacity` is the number of tiles of a block. The row becomes the tiles `tiles` of the block, and
/// the last of them contains only the columns that the tile before it also reads.
#[inline(always)]
fn separate_phases<F: Real>(rows: &[F], phases: &mut [F], capacity: usize, tiles: Range<usize>) {
    let rows = rows.chunks_exact(TILE * capacity + SPARE);
    let phases = phases.chunks_exact_mut(TILE * (capacity + SPARE));
    for (row, phases) in rows.zip(phases) {
        let (quads, _) = row.as_chunks::<TILE>();
        let mut phases = phases.chunks_exact_mut(capacity + SPARE);
        let [a, b, c, d]: [&mut [F]; TILE] =
            std::array::from_fn(|_| &mut phases.next().unwrap_or_default()[tiles.clone()]);
        for ((((a, b), c), d), quad) in a.iter_mut().zip(b).zip(c).zip(d).zip(quads) {
            [*a, *b, *c, *d] = *quad;
        }
    }
}

/// Transform `N` registers of tiles along their rows.
#[inline(always)]
fn transform_rows<S: Simd, F: Real, const N: usize>(
    simd: S,
    phases: &[F],
    transformed: &mut [F::Vector<S>],
    stride: usize,
) {
    let lanes = F::lanes::<S>();
    let length = N * lanes + SPARE;
    for register in 0..N {
        for (row, phases) in phases.chunks_exact(TILE * length).enumerate() {
            // The two last columns of the input of a tile are the first ones of the next tile.
            let mut values = [F::splat(simd, F::zero()); DEPTH];
            for column in 0..DEPTH {
                let start = column % TILE * length + register * lanes + column / TILE;
                values[column] = F::vectors::<S>(&phases[start..start + lanes])[0];
            }
            values = transform_input::<S, F>(simd, values);
            for column in 0..DEPTH {
                transformed[(row * DEPTH + column) * stride + register] = values[column];
            }
        }
    }
}
