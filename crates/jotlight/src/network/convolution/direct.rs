//! Direct correlation of a stack of planes with one filter.
//!
//! The sums of a tile of the output stay in registers, and each loaded value contributes to several
//! sums.

use std::ops::Range;

use super::PlanesView;
use crate::cpu::{self, Simd, WithSimd};
use crate::interrupt;
use crate::lanes::MAX_LANES;
use crate::network::tiling::strips::PlanesMut;
use crate::numbers::Real;

/// The maximum number of rows beyond the last one that a tile reads. Their results are discarded.
pub(super) const SPARE_ROWS: usize = 3;

/// The number of columns in a block. A block is computed from top to bottom, so that the source of
/// a tile is still in the cache for the tile below.
const DIRECT_BLOCK_COLUMNS: usize = 512;

/// The taps of a filter `(channels, rows, columns)` in the order in which the loops read them.
///
/// A tile reads several rows of the source. For each of them and each column of the filter, one tap
/// per row of the tile is stored. The tap is 0 if the filter at this row of the tile does not read
/// the row of the source.
#[derive(Clone, Debug)]
pub(super) struct FilterTiles<F> {
    values: Vec<F>,
    tile_rows: usize,
    rows: usize,
    columns: usize,
}

impl<F: Real> FilterTiles<F> {
    /// Return the filter with the taps `tap(channel, row, column)`.
    pub fn new(
        (channels, rows, columns): (usize, usize, usize),
        tap: impl Fn(usize, usize, usize) -> F,
    ) -> Self {
        let tile_rows = cpu::run(TileRows);
        let depth = rows + tile_rows - 1;
        let mut values = vec![F::zero(); channels * depth * columns * tile_rows];
        for channel in 0..channels {
            for row in 0..rows {
                for column in 0..columns {
                    let tap = tap(channel, row, column);
                    for tile_row in 0..tile_rows {
                        let index = (channel * depth + row + tile_row) * columns + column;
                        values[index * tile_rows + tile_row] = tap;
                    }
                }
            }
        }
        Self {
            values,
            tile_rows,
            rows,
            columns,
        }
    }

    /// Write Σ taps · source into the first plane of `out`.
    ///
    /// The source must be 0 outside the rows `nonzero`, which are the only ones that are read.
    pub fn correlate(
        &self,
        source: PlanesView<'_, F>,
        nonzero: Range<usize>,
        out: &mut PlanesMut<'_, F>,
    ) {
        cpu::run(DirectCorrelation {
            filter: self,
            source,
            nonzero,
            out,
        });
    }
}

/// The number of rows of a tile. The sums of a tile occupy 4 × 4 registers if the processor has 32
/// registers or more, and else 3 × 3.
struct TileRows;

impl WithSimd for TileRows {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        if S::REGISTER_COUNT < 32 { 3 } else { 4 }
    }
}

/// The correlation of `source` with one filter.
struct DirectCorrelation<'a, 'b, F> {
    filter: &'a FilterTiles<F>,
    source: PlanesView<'a, F>,
    nonzero: Range<usize>,
    out: &'a mut PlanesMut<'b, F>,
}

impl<F: Real> WithSimd for DirectCorrelation<'_, '_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        if self.filter.tile_rows == 4 {
            self.run::<S, 4, 4>(simd);
        } else {
            self.run::<S, 3, 3>(simd);
        }
    }
}

impl<F: Real> DirectCorrelation<'_, '_, F> {
    #[inline(always)]
    fn run<S: Simd, const R: usize, const C: usize>(mut self, simd: S) {
        let lanes = F::lanes::<S>();
        let (rows, width) = (self.out.height, self.out.width);
        let block = DIRECT_BLOCK_COLUMNS.next_multiple_of(C * lanes);
        for start in (0..width).step_by(block) {
            for row in (0..rows).step_by(R) {
                if interrupt::is_requested() {
                    return;
                }
                let mut column = start;
                let end = (start + block).min(width);
                while column < end {
                    let vectors = (end - column).div_ceil(lanes);
                    column += lanes
                        * match vectors.min(C) {
                            1 => self.tile::<S, R, 1>(simd, row, column),
                            2 => self.tile::<S, R, 2>(simd, row, column),
                            3 => self.tile::<S, R, 3>(simd, row, column),
                            _ => self.tile::<S, R, C>(simd, row, column),
                        };
                }
            }
        }
    }

    /// Compute a tile of `R` rows of `C` registers, and return `C`.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(
        &mut self,
        simd: S,
        top: usize,
        column: usize,
    ) -> usize {
        let FilterTiles {
            values,
            rows,
            columns,
            ..
        } = self.filter;
        let depth = rows + R - 1;
        let from = self.nonzero.start.saturating_sub(top).min(depth);
        let to = self.nonzero.end.saturating_sub(top).min(depth);
        let mut sums = [[F::splat(simd, F::zero()); C]; R];
        let channels = values.as_chunks::<R>().0.chunks_exact(depth * columns);
        for (taps, plane) in channels.zip(self.source.data.chunks(self.source.plane_stride)) {
            for row in from..to {
                let source = &plane[(top + row) * self.source.row_stride + column..];
                let taps = &taps[row * columns..][..*columns];
                // The rows of the tile to which this row of the source contributes.
                let tile_rows = ((row + 1).saturating_sub(*rows), (row + 1).min(R));
                sums = match tile_rows {
                    (0, 1) => add_row::<S, F, R, C, 0, 1>(simd, source, taps, sums),
                    (0, 2) => add_row::<S, F, R, C, 0, 2>(simd, source, taps, sums),
                    (0, 3) => add_row::<S, F, R, C, 0, 3>(simd, source, taps, sums),
                    (1, 2) => add_row::<S, F, R, C, 1, 2>(simd, source, taps, sums),
                    (1, 3) => add_row::<S, F, R, C, 1, 3>(simd, source, taps, sums),
                    (2, 3) => add_row::<S, F, R, C, 2, 3>(simd, source, taps, sums),
                    (1, 4) => add_row::<S, F, R, C, 1, 4>(simd, source, taps, sums),
                    (2, 4) => add_row::<S, F, R, C, 2, 4>(simd, source, taps, sums),
                    (3, 4) => add_row::<S, F, R, C, 3, 4>(simd, source, taps, sums),
                    _ => add_row::<S, F, R, C, 0, R>(simd, source, taps, sums),
                };
            }
        }
        let length = (self.out.width - column).min(C * F::lanes::<S>());
        for (row, sums) in (top..self.out.height).zip(sums) {
            store::<S, F, C>(sums, &mut self.out.row(0, row)[column..][..length]);
        }
        C
    }
}

/// Add one row of the source to the rows `FROM` to `TO` of a tile.
#[inline(always)]
fn add_row<S, F, const R: usize, const C: usize, const FROM: usize, const TO: usize>(
    simd: S,
    source: &[F],
    taps: &[[F; R]],
    mut sums: [[F::Vector<S>; C]; R],
) -> [[F::Vector<S>; C]; R]
where
    S: Simd,
    F: Real,
{
    let length = C * F::lanes::<S>();
    let source = &source[..taps.len() - 1 + length];
    for (taps, window) in taps.iter().zip(source.windows(length)) {
        let window = F::vectors::<S>(window);
        let window: [_; C] = std::array::from_fn(|column| window[column]);
        for row in FROM..TO.min(R) {
            let tap = F::splat(simd, taps[row]);
            for column in 0..C {
                sums[row][column] = F::multiply_add(simd, window[column], tap, sums[row][column]);
            }
        }
    }
    sums
}

/// Write registers to a slice, which may be shorter.
#[inline(always)]
pub(super) fn store<S: Simd, F: Real, const C: usize>(sums: [F::Vector<S>; C], out: &mut [F]) {
    let mut parts = out.chunks_exact_mut(F::lanes::<S>());
    let mut sums = sums.into_iter();
    for (part, sum) in parts.by_ref().zip(sums.by_ref()) {
        F::vectors_mut::<S>(part)[0] = sum;
    }
    let rest = parts.into_remainder();
    if let Some(sum) = sums.next()
        && !rest.is_empty()
    {
        let mut whole = [F::zero(); MAX_LANES];
        F::vectors_mut::<S>(&mut whole)[0] = sum;
        rest.copy_from_slice(&whole[..rest.len()]);
    }
}
