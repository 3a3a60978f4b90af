//! Direct correlation of a stack of planes with several filters.
//!
//! The sums of a tile of several outputs stay in registers, and each loaded value contributes to
//! all of these outputs.

use super::PlanesView;
use super::direct::store;
use crate::cpu::{self, Simd, WithSimd};
use crate::interrupt;
use crate::network::tiling::strips::PlanesMut;
use crate::numbers::Real;

/// The number of outputs in a large group, which requires a processor with 32 vector registers or
/// more.
const LARGE_GROUP: usize = 8;
/// The number of outputs in a small group.
const SMALL_GROUP: usize = 4;

/// The number of registers per output in a tile of a large group, or of a small group if the
/// processor has fewer than 32 registers.
const NARROW_TILE: usize = 3;
/// The number of registers per output in a tile of a small group if the processor has 32
/// registers or more.
const WIDE_TILE: usize = 6;

/// The taps of filters `(outputs, inputs, rows, columns)` in the order in which the loops read
/// them.
///
/// The outputs are divided into groups. The taps of a group are ordered by input, row, column, and
/// output.
#[derive(Clone, Debug)]
pub(super) struct ChannelBank<F> {
    groups: Vec<OutputGroup<F>>,
    outputs: usize,
    rows: usize,
    columns: usize,
}

/// The taps of a group. An entry holds one tap per output.
#[derive(Clone, Debug)]
enum OutputGroup<F> {
    Large(Vec<[F; LARGE_GROUP]>),
    Small(Vec<[F; SMALL_GROUP]>),
}

impl<F: Real> ChannelBank<F> {
    /// Return the bank with the taps `tap(output, input, row, column)`.
    pub fn new(
        (outputs, inputs, rows, columns): (usize, usize, usize, usize),
        tap: impl Fn(usize, usize, usize, usize) -> F,
    ) -> Self {
        let large_groups = cpu::run(RegisterCount) >= 32;
        let (mut groups, mut first) = (Vec::new(), 0);
        while first < outputs {
            // Taps of 0 fill the last group.
            let tap = |output: usize, input, row, column| match first + output {
                output if output < outputs => tap(output, input, row, column),
                _ => F::zero(),
            };
            if large_groups && outputs - first > SMALL_GROUP {
                groups.push(OutputGroup::Large(ordered_taps(
                    (inputs, rows, columns),
                    tap,
                )));
                first += LARGE_GROUP;
            } else {
                groups.push(OutputGroup::Small(ordered_taps(
                    (inputs, rows, columns),
                    tap,
                )));
                first += SMALL_GROUP;
            }
        }
        Self {
            groups,
            outputs,
            rows,
            columns,
        }
    }

    /// Return the number of filters.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Write Σ taps · source into the planes `out`.
    pub fn correlate(&self, source: PlanesView<'_, F>, out: &mut PlanesMut<'_, F>) {
        cpu::run(BankCorrelation {
            bank: self,
            source,
            out,
        });
    }
}

/// Return the taps of a group, ordered by input, row, and column.
fn ordered_taps<F, const O: usize>(
    (inputs, rows, columns): (usize, usize, usize),
    tap: impl Fn(usize, usize, usize, usize) -> F,
) -> Vec<[F; O]> {
    let mut taps = Vec::with_capacity(inputs * rows * columns);
    for input in 0..inputs {
        for row in 0..rows {
            for column in 0..columns {
                taps.push(std::array::from_fn(|output| {
                    tap(output, input, row, column)
                }));
            }
        }
    }
    taps
}

/// The number of vector registers of the processor.
struct RegisterCount;

impl WithSimd for RegisterCount {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::REGISTER_COUNT
    }
}

/// The correlation of `source` with a bank.
struct BankCorrelation<'a, 'b, F> {
    bank: &'a ChannelBank<F>,
    source: PlanesView<'a, F>,
    out: &'a mut PlanesMut<'b, F>,
}

impl<F: Real> WithSimd for BankCorrelation<'_, '_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (bank, lanes) = (self.bank, F::lanes::<S>());
        // All outputs of a block of columns are computed while its source is in the cache.
        let block = WIDE_TILE * lanes;
        for row in 0..self.out.height {
            if interrupt::is_requested() {
                return;
            }
            let width = self.out.width;
            for column in (0..width).step_by(block) {
                let columns = column..(column + block).min(width);
                let mut first = 0;
                for group in &bank.groups {
                    let columns = columns.clone();
                    match group {
                        OutputGroup::Large(taps) => {
                            self.block::<S, LARGE_GROUP, NARROW_TILE>(
                                simd, taps, first, row, columns,
                            );
                            first += LARGE_GROUP;
                        }
                        OutputGroup::Small(taps) if const { S::REGISTER_COUNT < 32 } => {
                            self.block::<S, SMALL_GROUP, NARROW_TILE>(
                                simd, taps, first, row, columns,
                            );
                            first += SMALL_GROUP;
                        }
                        OutputGroup::Small(taps) => {
                            self.block::<S, SMALL_GROUP, WIDE_TILE>(
                                simd, taps, first, row, columns,
                            );
                            first += SMALL_GROUP;
                        }
                    }
                }
            }
        }
    }
}

impl<F: Real> BankCorrelation<'_, '_, F> {
    /// Compute a range of columns in a row of `O` outputs, starting at the output `first`.
    #[inline(always)]
    fn block<S: Simd, const O: usize, const C: usize>(
        &mut self,
        simd: S,
        taps: &[[F; O]],
        first: usize,
        row: usize,
        columns: std::ops::Range<usize>,
    ) {
        let lanes = F::lanes::<S>();
        let mut column = columns.start;
        while column < columns.end {
            let vectors = (columns.end - column).div_ceil(lanes);
            column += lanes
                * match vectors.min(C) {
                    1 => self.tile::<S, O, 1>(simd, taps, first, row, column),
                    2 => self.tile::<S, O, 2>(simd, taps, first, row, column),
                    3 => self.tile::<S, O, 3>(simd, taps, first, row, column),
                    // A wide tile would read planes beyond their end.
                    4 if const { C > 4 } => self.tile::<S, O, 4>(simd, taps, first, row, column),
                    5 if const { C > 5 } => self.tile::<S, O, 5>(simd, taps, first, row, column),
                    _ => self.tile::<S, O, C>(simd, taps, first, row, column),
                };
        }
    }

    /// Compute `C` registers in a row of `O` outputs, and return `C`.
    #[inline(always)]
    fn tile<S: Simd, const O: usize, const C: usize>(
        &mut self,
        simd: S,
        taps: &[[F; O]],
        first: usize,
        row: usize,
        column: usize,
    ) -> usize {
        let ChannelBank { rows, columns, .. } = *self.bank;
        let length = C * F::lanes::<S>();
        let stride = self.source.plane_stride;
        let mut sums = [[F::splat(simd, F::zero()); C]; O];
        // The last registers of a tile may lie beyond the plane. Their sums are discarded.
        if (rows, columns) == (1, 1) {
            // A filter of one tap per input needs no loops over its rows and columns.
            let start = row * self.source.row_stride + column;
            let planes = self.source.data[start..].chunks(stride);
            for (plane, taps) in planes.zip(taps) {
                add_tap::<S, F, O, C>(simd, &plane[..length], taps, &mut sums);
            }
            return self.store::<S, O, C>(first, row, column, sums);
        }
        for (input, taps) in taps.chunks_exact(rows * columns).enumerate() {
            let plane = &self.source.data[input * stride..];
            for (tap_row, taps) in taps.chunks_exact(columns).enumerate() {
                let source = &plane[(row + tap_row) * self.source.row_stride + column..];
                let source = &source[..columns - 1 + length];
                if let Ok(taps) = <&[[F; O]; 3]>::try_from(taps) {
                    // The compiler unrolls the loop, which is that of the first deep layer.
                    for tap in 0..3 {
                        let window = &source[tap..][..length];
                        add_tap::<S, F, O, C>(simd, window, &taps[tap], &mut sums);
                    }
                } else {
                    for (taps, window) in taps.iter().zip(source.windows(length)) {
                        add_tap::<S, F, O, C>(simd, window, taps, &mut sums);
                    }
                }
            }
        }
        self.store::<S, O, C>(first, row, column, sums)
    }

    /// Write the sums of a tile, and return `C`.
    #[inline(always)]
    fn store<S: Simd, const O: usize, const C: usize>(
        &mut self,
        first: usize,
        row: usize,
        column: usize,
        sums: [[F::Vector<S>; C]; O],
    ) -> usize {
        let length = (self.out.width - column).min(C * F::lanes::<S>());
        for (plane, sums) in (first..self.bank.outputs).zip(sums) {
            store::<S, F, C>(sums, &mut self.out.row(plane, row)[column..][..length]);
        }
        C
    }
}

/// Add the products of `C` registers and one tap per output.
#[inline(always)]
fn add_tap<S: Simd, F: Real, const O: usize, const C: usize>(
    simd: S,
    source: &[F],
    taps: &[F; O],
    sums: &mut [[F::Vector<S>; C]; O],
) {
    let source = &F::vectors::<S>(source)[..C];
    // Values that are loaded first leave a register for each sum.
    let source: [_; C] = std::array::from_fn(|column| source[column]);
    for output in 0..O {
        let tap = F::splat(simd, taps[output]);
        for column in 0..C {
            sums[output][column] = F::multiply_add(simd, source[column], tap, sums[output][column]);
        }
    }
}
