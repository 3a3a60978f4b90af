//! Sums of products over a sliding window, in tiles that stay in registers: every number that is loaded serves several sums.

use std::ops::Range;

use crate::cpu::{self, Simd, WithSimd};
use crate::numbers::LANES;
use crate::numbers::Real;

/// Rows past the last one that a tile may read, and then throws away.
pub(crate) const SPARE_ROWS: usize = 3;
/// Columns past the last one that [`gradient`] may read.
pub(crate) const SPARE_COLUMNS: usize = 4;

/// Columns that tiles are worked on in, from the top to the bottom.
const STRETCH: usize = 512;

/// Planes in rows with room to read past their ends.
#[derive(Clone, Copy)]
pub(crate) struct Planes<'a, F> {
    pub data: &'a [F],
    /// Numbers from one plane to the next, and from one row to the next.
    pub plane: usize,
    pub stride: usize,
}

/// The taps of a filter `(channels, lines, columns)` in the order in which tiles of `rows` rows take them: for every row of the
/// source and every column the taps that serve the rows of the tile; 0 where there is none.
#[derive(Clone, Debug)]
pub(crate) struct Taps<F> {
    numbers: Vec<F>,
    rows: usize,
    lines: usize,
    columns: usize,
}

impl<F: Real> Taps<F> {
    /// `tap(channel, line, column)` tells them.
    pub fn new(
        (channels, lines, columns): (usize, usize, usize),
        tap: impl Fn(usize, usize, usize) -> F,
    ) -> Self {
        let rows = cpu::run(TileRows);
        let depth = lines + rows - 1;
        let mut taps = vec![F::zero(); channels * depth * columns * rows];
        for channel in 0..channels {
            for line in 0..lines {
                for column in 0..columns {
                    let tap = tap(channel, line, column);
                    for row in 0..rows {
                        let place = (channel * depth + line + row) * columns + column;
                        taps[place * rows + row] = tap;
                    }
                }
            }
        }
        Self {
            numbers: taps,
            rows,
            lines,
            columns,
        }
    }

    /// Σ taps · source into rows of `width`, the first of them at row `first` of the source; source rows outside of `live` are
    /// known to be 0.
    pub fn correlate(
        &self,
        source: Planes<'_, F>,
        first: usize,
        live: Range<usize>,
        width: usize,
        out: &mut [F],
    ) {
        cpu::run(Correlate {
            taps: self,
            source,
            first,
            live,
            width,
            out,
        });
    }
}

/// With 32 registers tiles of 4 rows and 4 registers in each, with 16 of 3 and 3.
struct TileRows;

impl WithSimd for TileRows {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        if S::REGISTER_COUNT < 32 { 3 } else { 4 }
    }
}

struct Correlate<'a, F> {
    taps: &'a Taps<F>,
    source: Planes<'a, F>,
    first: usize,
    live: Range<usize>,
    width: usize,
    out: &'a mut [F],
}

impl<F: Real> WithSimd for Correlate<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        if self.taps.rows == 4 {
            self.tiles::<S, 4, 4>(simd);
        } else {
            self.tiles::<S, 3, 3>(simd);
        }
    }
}

impl<F: Real> Correlate<'_, F> {
    #[inline(always)]
    fn tiles<S: Simd, const R: usize, const C: usize>(mut self, simd: S) {
        let lanes = F::lanes::<S>();
        let rows = self.out.len() / self.width;
        // Stretch by stretch, so that the rows of the source stay near the core from one tile to the one below.
        let stretch = STRETCH.next_multiple_of(C * lanes);
        let starts = (0..self.width).step_by(stretch);
        for (start, row) in
            starts.flat_map(|start| (0..rows).step_by(R).map(move |row| (start, row)))
        {
            let mut column = start;
            let end = (start + stretch).min(self.width);
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

    /// `R` rows of `C` registers.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(
        &mut self,
        simd: S,
        row: usize,
        column: usize,
    ) -> usize {
        let Taps {
            numbers,
            lines,
            columns,
            ..
        } = self.taps;
        let top = self.first + row;
        let depth = lines + R - 1;
        // Rows of the source, from the tile's first on, that are not all 0.
        let from = self.live.start.saturating_sub(top).min(depth);
        let to = self.live.end.saturating_sub(top).min(depth);
        let mut sums = [[F::splat(simd, F::zero()); C]; R];
        let channels = numbers.as_chunks::<R>().0.chunks_exact(depth * columns);
        for (taps, plane) in channels.zip(self.source.data.chunks(self.source.plane)) {
            for line in from..to {
                let source = &plane[(top + line) * self.source.stride + column..];
                let taps = &taps[line * columns..][..*columns];
                // Which rows of the tile this row of the source is for.
                let rows = ((line + 1).saturating_sub(*lines), (line + 1).min(R));
                sums = match rows {
                    (0, 1) => add::<S, F, R, C, 0, 1>(simd, source, taps, sums),
                    (0, 2) => add::<S, F, R, C, 0, 2>(simd, source, taps, sums),
                    (0, 3) => add::<S, F, R, C, 0, 3>(simd, source, taps, sums),
                    (1, 2) => add::<S, F, R, C, 1, 2>(simd, source, taps, sums),
                    (1, 3) => add::<S, F, R, C, 1, 3>(simd, source, taps, sums),
                    (2, 3) => add::<S, F, R, C, 2, 3>(simd, source, taps, sums),
                    (1, 4) => add::<S, F, R, C, 1, 4>(simd, source, taps, sums),
                    (2, 4) => add::<S, F, R, C, 2, 4>(simd, source, taps, sums),
                    (3, 4) => add::<S, F, R, C, 3, 4>(simd, source, taps, sums),
                    _ => add::<S, F, R, C, 0, R>(simd, source, taps, sums),
                };
            }
        }
        let lanes = F::lanes::<S>();
        let length = (self.width - column).min(C * lanes);
        for (out, sums) in self.out.chunks_exact_mut(self.width).skip(row).zip(sums) {
            let out = &mut out[column..][..length];
            let mut parts = out.chunks_exact_mut(lanes);
            let mut sums = sums.into_iter();
            for (part, sum) in parts.by_ref().zip(sums.by_ref()) {
                F::vectors_mut::<S>(part)[0] = sum;
            }
            // What is left is shorter than a register.
            if let Some(sum) = sums.next() {
                let rest = parts.into_remainder();
                let mut whole = [F::zero(); LANES];
                F::vectors_mut::<S>(&mut whole)[0] = sum;
                rest.copy_from_slice(&whole[..rest.len()]);
            }
        }
        C
    }
}

/// Adds one row of the source to the rows `FROM` to `TO` of a tile.
#[inline(always)]
fn add<S, F, const R: usize, const C: usize, const FROM: usize, const TO: usize>(
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

/// Adds Σ weights · source for every shift of the source by `(lines, columns)`, to `sums[line][column]`. Weights come in rows of
/// `width`, a multiple of [`LANES`], with [`SPARE_ROWS`] rows of 0 before the first and after the last.
pub(crate) fn gradient<F: Real>(
    source: &[F],
    stride: usize,
    weights: &[F],
    width: usize,
    shifts: (usize, usize),
    sums: &mut [f64],
) {
    cpu::run(Gradient {
        source,
        stride,
        weights,
        width,
        shifts,
        sums,
    });
}

struct Gradient<'a, F> {
    source: &'a [F],
    stride: usize,
    weights: &'a [F],
    width: usize,
    shifts: (usize, usize),
    sums: &'a mut [f64],
}

impl<F: Real> WithSimd for Gradient<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        if S::REGISTER_COUNT < 32 {
            self.tiles::<S, 3, 3>(simd);
        } else {
            self.tiles::<S, 4, 5>(simd);
        }
    }
}

impl<F: Real> Gradient<'_, F> {
    #[inline(always)]
    fn tiles<S: Simd, const R: usize, const C: usize>(&mut self, simd: S) {
        for line in (0..self.shifts.0).step_by(R) {
            for column in (0..self.shifts.1).step_by(C) {
                let tile = self.tile::<S, R, C>(simd, line, column);
                let rows = self.sums.chunks_exact_mut(self.shifts.1).skip(line);
                for (sums, tile) in rows.zip(tile) {
                    for (sum, tile) in sums[column..].iter_mut().zip(tile) {
                        *sum += F::total(simd, tile).as_f64();
                    }
                }
            }
        }
    }

    /// The sums of `R` lines and `C` columns of shifts.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(
        &self,
        simd: S,
        line: usize,
        column: usize,
    ) -> [[F::Vector<S>; C]; R] {
        let lanes = F::lanes::<S>();
        let rows = self.weights.len() / self.width - 2 * SPARE_ROWS;
        let mut sums = [[F::splat(simd, F::zero()); C]; R];
        for row in 0..rows + R - 1 {
            let source = &self.source[(line + row) * self.stride + column..];
            let weights: [&[F::Vector<S>]; R] = std::array::from_fn(|back| {
                let row = SPARE_ROWS + row - back;
                F::vectors::<S>(&self.weights[row * self.width..][..self.width])
            });
            for (step, start) in (0..self.width).step_by(lanes).enumerate() {
                let source = &source[start..][..lanes + C - 1];
                let windows: [_; C] =
                    std::array::from_fn(|shift| F::vectors::<S>(&source[shift..][..lanes])[0]);
                for row in 0..R {
                    let weights = weights[row][step];
                    for shift in 0..C {
                        sums[row][shift] =
                            F::multiply_add(simd, windows[shift], weights, sums[row][shift]);
                    }
                }
            }
        }
        sums
    }
}
