//! The transform of the input of a block of tiles.

use std::ops::Range;

use super::transforms::{DEPTH, transform_input};
use super::{BLOCK_REGISTERS, TILE};
use crate::border::mirror_index;
use crate::cpu::Simd;
use crate::lanes::MAX_LANES;
use crate::network::tiling::strips::{PlaneRow, StripedPlanes};
use crate::numbers::Real;

/// The rows and columns of the input of a block: rows of tiles, one below the other.
pub(super) struct InputBlock<'a, F> {
    pub source: &'a StripedPlanes<'a, F>,
    /// The first row and column of the block's output.
    pub top: usize,
    pub left: usize,
    /// The numbers of output rows and columns.
    pub height: usize,
    pub width: usize,
}

/// The buffers for the transform of planes.
pub(super) struct InputBuffers<'a, F> {
    /// Rows of two planes after the transform along columns, `(2, DEPTH, columns)`. The output's
    /// first column is [`MARGIN`].
    pub rows: &'a mut [F],
    /// The columns of the tiles of two planes, `(2, DEPTH, DEPTH, tiles)`: planes, rows of a tile,
    /// and columns of a tile. After each column, [`MAX_LANES`] values are free. Only blocks with
    /// several rows of tiles need them.
    pub columns: &'a mut [F],
}

/// The number of columns of the buffer of rows before the first column of the output.
const MARGIN: usize = MAX_LANES;
/// The maximum number of rows of tiles in a block.
const MAX_TILE_ROWS: usize = BLOCK_REGISTERS * MAX_LANES;
/// The maximum number of columns that the loops read.
const MAX_COLUMNS: usize = MARGIN + TILE * BLOCK_REGISTERS * MAX_LANES + MAX_LANES;

/// The rows of the input that a row of tiles reads. None is a row of zeros.
type InputRows<'a, F> = [Option<PlaneRow<'a, F>>; DEPTH];

impl<F: Real> InputBuffers<'_, F> {
    /// Return the lengths of the buffers for a block of `tiles` tiles.
    pub const fn lengths(tiles: usize) -> (usize, usize) {
        (
            2 * DEPTH * (MARGIN + TILE * tiles + MAX_LANES),
            2 * DEPTH * DEPTH * (tiles + MAX_LANES),
        )
    }
}

impl<F: Real> InputBlock<'_, F> {
    /// Write the transform of the planes into `transformed`. Its shape is `(PRODUCTS, inputs, N)`
    /// with a distance of `stride` values between products, and its elements are registers.
    ///
    /// The order of the tiles in a register is that of [`Lanes::deinterleave`], unless the block has
    /// several rows of tiles.
    ///
    /// [`Lanes::deinterleave`]: crate::lanes::Lanes::deinterleave
    #[inline(always)]
    pub fn transform<S: Simd, const N: usize>(
        &self,
        simd: S,
        inputs: usize,
        buffers: &mut InputBuffers<'_, F>,
        (transformed, stride): (&mut [F], usize),
    ) {
        if self.height > TILE {
            return self.transform_rows_of_tiles::<S, N>(
                simd,
                inputs,
                buffers,
                (transformed, stride),
            );
        }
        let rows = self.find_rows(0);
        let stride = stride / F::lanes::<S>();
        let half = buffers.rows.len() / 2;
        let (mut current, mut previous) = buffers.rows.split_at_mut(half);
        // The transform along the rows reads values across two stores. It would wait for them
        // without another plane in between.
        for input in 0..=inputs {
            if input < inputs {
                self.transform_columns(simd, &rows, input, current);
            }
            if input > 0 {
                let vectors = &mut F::vectors_mut::<S>(transformed)[(input - 1) * N..];
                separate_and_transform_rows::<S, F, N>(simd, previous, vectors, stride);
            }
            std::mem::swap(&mut current, &mut previous);
        }
    }

    /// Do the same for several rows of tiles of a narrow plane, which fill the registers together.
    #[inline(always)]
    fn transform_rows_of_tiles<S: Simd, const N: usize>(
        &self,
        simd: S,
        inputs: usize,
        buffers: &mut InputBuffers<'_, F>,
        (transformed, stride): (&mut [F], usize),
    ) {
        let mut rows = [[None; DEPTH]; MAX_TILE_ROWS];
        let rows = &mut rows[..self.height.div_ceil(TILE)];
        for (tile_row, rows) in rows.iter_mut().enumerate() {
            *rows = self.find_rows(tile_row);
        }
        let tiles = self.width.div_ceil(TILE);
        let stride = stride / F::lanes::<S>();
        let (half, half_rows) = (buffers.columns.len() / 2, buffers.rows.len() / 2);
        let buffer = &mut buffers.rows[..half_rows];
        let (mut current, mut previous) = buffers.columns.split_at_mut(half);
        for input in 0..=inputs {
            if input < inputs {
                for (tile_row, rows) in rows.iter().enumerate() {
                    self.transform_columns(simd, rows, input, buffer);
                    let tiles = tile_row * tiles..(tile_row + 1) * tiles;
                    let capacity = N * F::lanes::<S>();
                    separate_columns::<S, F>(simd, buffer, current, capacity, tiles);
                }
            }
            if input > 0 {
                let vectors = &mut F::vectors_mut::<S>(transformed)[(input - 1) * N..];
                transform_rows::<S, F, N>(simd, previous, vectors, stride);
            }
            std::mem::swap(&mut current, &mut previous);
        }
    }

    /// Return the input of a row of tiles.
    ///
    /// The rows that the output does not depend on are 0. Then the result does not depend on the
    /// strips that are in memory.
    #[inline(always)]
    fn find_rows(&self, tile_row: usize) -> InputRows<'_, F> {
        let mut rows = [None; DEPTH];
        for (row, source) in rows.iter_mut().enumerate() {
            let row = TILE * tile_row + row;
            if row < self.height + 2 {
                let row = (self.top + row) as isize - 1;
                *source = Some(self.source.row(mirror_index(row, self.source.size.0)));
            }
        }
        rows
    }

    /// Transform a plane along its columns.
    #[inline(always)]
    fn transform_columns<S: Simd>(
        &self,
        simd: S,
        rows: &InputRows<'_, F>,
        plane: usize,
        out: &mut [F],
    ) {
        let lanes = F::lanes::<S>();
        let tile_columns = self.width.next_multiple_of(TILE);
        // The tiles read one column before the output, and one after it.
        let before = if self.left == 0 { 0 } else { lanes };
        let registers = (before + tile_columns + 1).div_ceil(lanes);
        let zeros = [F::zero(); MAX_COLUMNS];
        let mut sources = [&F::vectors::<S>(&zeros)[..registers]; DEPTH];
        for (source, row) in sources.iter_mut().zip(rows) {
            if let Some(row) = row {
                let (values, lead) = row.plane_and_lead(plane);
                let first = lead + self.left - self.source.columns.start - before;
                *source = &F::vectors::<S>(&values[first..][..registers * lanes])[..registers];
            }
        }
        let row_length = out.len() / DEPTH;
        // Iterators need no bounds checks.
        let [a, b, c, d, e, f] = sources;
        let values = a.iter().zip(b).zip(c).zip(d).zip(e).zip(f);
        let [p, q, r, s, t, u] = split(out, row_length);
        let p = &mut F::vectors_mut::<S>(&mut p[MARGIN - before..])[..registers];
        let q = &mut F::vectors_mut::<S>(&mut q[MARGIN - before..])[..registers];
        let r = &mut F::vectors_mut::<S>(&mut r[MARGIN - before..])[..registers];
        let s = &mut F::vectors_mut::<S>(&mut s[MARGIN - before..])[..registers];
        let t = &mut F::vectors_mut::<S>(&mut t[MARGIN - before..])[..registers];
        let u = &mut F::vectors_mut::<S>(&mut u[MARGIN - before..])[..registers];
        let results = p.iter_mut().zip(q).zip(r).zip(s).zip(t).zip(u);
        for ((((((a, b), c), d), e), f), (((((p, q), r), s), t), u)) in values.zip(results) {
            [*p, *q, *r, *s, *t, *u] = transform_input::<S, F>(simd, [*a, *b, *c, *d, *e, *f]);
        }
        let known = (self.source.columns.end - self.left).min(tile_columns + 1);
        for row in out.chunks_exact_mut(row_length) {
            // The planes continue symmetrically.
            if self.left == 0 {
                row[MARGIN - 1] = row[MARGIN];
            }
            if known <= tile_columns {
                row[MARGIN + known] = row[MARGIN + known - 1];
                // The last tile may be wider than the output.
                row[MARGIN + known + 1..=MARGIN + tile_columns.max(known)].fill(F::zero());
            }
        }
    }
}

/// Divide values into [`DEPTH`] parts of the same length.
///
/// The compiler may make a function of a closure that divides, and a scatter of a loop. Both would
/// take longer than the work on a narrow plane.
#[inline(always)]
fn split<F>(values: &mut [F], length: usize) -> [&mut [F]; DEPTH] {
    let (a, rest) = values.split_at_mut(length);
    let (b, rest) = rest.split_at_mut(length);
    let (c, rest) = rest.split_at_mut(length);
    let (d, rest) = rest.split_at_mut(length);
    let (e, f) = rest.split_at_mut(length);
    [a, b, c, d, e, f]
}

/// Write each of the [`DEPTH`] columns of the tiles to a contiguous row, for each row.
///
/// `capacity` is the number of tiles of a block. The tiles become the tiles `tiles` of the block.
/// Values beyond them have no meaning. Those of the next tiles replace them.
#[inline(always)]
fn separate_columns<S: Simd, F: Real>(
    _: S,
    rows: &[F],
    columns: &mut [F],
    capacity: usize,
    tiles: Range<usize>,
) {
    let lanes = F::lanes::<S>();
    let rows = rows.chunks_exact(rows.len() / DEPTH);
    for (row, columns) in rows.zip(columns.chunks_exact_mut(DEPTH * (capacity + MAX_LANES))) {
        let [before, a, b, c, d, after] = split(columns, capacity + MAX_LANES);
        let (before, after) = (&mut before[tiles.start..], &mut after[tiles.start..]);
        let (a, b) = (&mut a[tiles.start..], &mut b[tiles.start..]);
        let (c, d) = (&mut c[tiles.start..], &mut d[tiles.start..]);
        let (quads, _) = row[MARGIN..][..TILE * tiles.len()].as_chunks::<TILE>();
        let values = a.iter_mut().zip(b).zip(c).zip(d.iter_mut());
        for ((((a, b), c), d), quad) in values.zip(quads) {
            [*a, *b, *c, *d] = *quad;
        }
        // The column before a tile is the last one of the tile before, and the column after it is
        // the first one of the next tile.
        for start in (0..tiles.len()).step_by(lanes) {
            let value = F::vectors::<S>(&d[start..start + lanes])[0];
            F::vectors_mut::<S>(&mut before[start + 1..start + 1 + lanes])[0] = value;
            let value = F::vectors::<S>(&a[start + 1..start + 1 + lanes])[0];
            F::vectors_mut::<S>(&mut after[start..start + lanes])[0] = value;
        }
        before[0] = row[MARGIN - 1];
        after[tiles.len() - 1] = row[MARGIN + TILE * tiles.len()];
    }
}

/// Separate the columns of `N` registers of tiles, and transform the tiles along their rows.
#[inline(always)]
fn separate_and_transform_rows<S: Simd, F: Real, const N: usize>(
    simd: S,
    rows: &[F],
    transformed: &mut [F::Vector<S>],
    stride: usize,
) {
    let length = TILE * F::lanes::<S>();
    let row_length = rows.len() / DEPTH;
    for row in 0..DEPTH {
        // The first column of a tile is one before its output.
        let columns = &rows[row * row_length + MARGIN - 1..][..N * length + TILE];
        for register in 0..N {
            let columns = &columns[register * length..];
            let first = F::vectors::<S>(&columns[..length]);
            let next = F::vectors::<S>(&columns[TILE..][..length]);
            let first = [first[0], first[1], first[2], first[3]];
            let [a, b, c, d] = F::deinterleave(simd, first);
            let [e, f, ..] = F::deinterleave(simd, [next[0], next[1], next[2], next[3]]);
            let values = transform_input::<S, F>(simd, [a, b, c, d, e, f]);
            for column in 0..DEPTH {
                transformed[(row * DEPTH + column) * stride + register] = values[column];
            }
        }
    }
}

/// Transform `N` registers of tiles along their rows.
#[inline(always)]
fn transform_rows<S: Simd, F: Real, const N: usize>(
    simd: S,
    columns: &[F],
    transformed: &mut [F::Vector<S>],
    stride: usize,
) {
    let columns = F::vectors::<S>(columns);
    let length = N + MAX_LANES / F::lanes::<S>();
    for register in 0..N {
        for (row, columns) in columns.chunks_exact(DEPTH * length).enumerate() {
            let mut values = [F::splat(simd, F::zero()); DEPTH];
            for column in 0..DEPTH {
                values[column] = columns[column * length + register];
            }
            values = transform_input::<S, F>(simd, values);
            for column in 0..DEPTH {
                transformed[(row * DEPTH + column) * stride + register] = values[column];
            }
        }
    }
}
