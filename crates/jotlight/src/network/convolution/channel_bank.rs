//! Banks of many filters, in tiles that stay in registers: several outputs at a time share every number that is loaded.

use crate::cpu::{self, Simd, WithSimd};
use crate::network::convolution::direct::Planes;
use crate::numbers::LANES;
use crate::numbers::Real;

/// Outputs that are worked on at a time: with 32 registers and with 16, and what is left over.
const MANY: usize = 8;
const FEW: usize = 4;

/// Registers of a row, for many outputs and for few.
const WIDE: usize = 3;
const WIDER: usize = 6;

/// The taps of a bank `(outputs, inputs, lines, columns)` in the order of the loops: some outputs at a time, of these every input, line
/// and column, and there the outputs side by side.
#[derive(Clone, Debug)]
pub(crate) struct Bank<F> {
    blocks: Vec<Block<F>>,
    outputs: usize,
    lines: usize,
    columns: usize,
}

#[derive(Clone, Debug)]
enum Block<F> {
    Many(Vec<[F; MANY]>),
    Few(Vec<[F; FEW]>),
}

impl<F: Real> Bank<F> {
    /// `tap(output, input, line, column)` tells them, for loops that run forward.
    pub fn new(
        (outputs, inputs, lines, columns): (usize, usize, usize, usize),
        tap: impl Fn(usize, usize, usize, usize) -> F,
    ) -> Self {
        let many = cpu::run(Registers) >= 32;
        let (mut blocks, mut first) = (Vec::new(), 0);
        while first < outputs {
            let at = |output: usize, input, line, column| match first + output {
                output if output < outputs => tap(output, input, line, column),
                _ => F::zero(),
            };
            if many && outputs - first > FEW {
                blocks.push(Block::Many(in_order((inputs, lines, columns), at)));
                first += MANY;
            } else {
                blocks.push(Block::Few(in_order((inputs, lines, columns), at)));
                first += FEW;
            }
        }
        Self {
            blocks,
            outputs,
            lines,
            columns,
        }
    }

    /// How many filters there are.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Σ taps · source into planes `(outputs, height, width)`.
    pub fn correlate(&self, source: Planes<'_, F>, (height, width): (usize, usize), out: &mut [F]) {
        cpu::run(Correlate {
            bank: self,
            source,
            height,
            width,
            out,
        });
    }
}

/// `tap(output, input, line, column)` of some outputs, side by side.
fn in_order<F, const O: usize>(
    (inputs, lines, columns): (usize, usize, usize),
    tap: impl Fn(usize, usize, usize, usize) -> F,
) -> Vec<[F; O]> {
    let mut taps = Vec::with_capacity(inputs * lines * columns);
    for input in 0..inputs {
        for line in 0..lines {
            for column in 0..columns {
                taps.push(std::array::from_fn(|output| {
                    tap(output, input, line, column)
                }));
            }
        }
    }
    taps
}

struct Registers;

impl WithSimd for Registers {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::REGISTER_COUNT
    }
}

struct Correlate<'a, F> {
    bank: &'a Bank<F>,
    source: Planes<'a, F>,
    height: usize,
    width: usize,
    out: &'a mut [F],
}

impl<F: Real> WithSimd for Correlate<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (bank, lanes) = (self.bank, F::lanes::<S>());
        for row in 0..self.height {
            // All outputs of a few columns, while what they read is near the core.
            let stretch = WIDER * lanes;
            for column in (0..self.width).step_by(stretch) {
                let end = (column + stretch).min(self.width);
                let mut first = 0;
                for block in &bank.blocks {
                    match block {
                        Block::Many(taps) => {
                            self.stretch::<S, MANY, WIDE>(simd, taps, first, row, column..end);
                            first += MANY;
                        }
                        Block::Few(taps) if S::REGISTER_COUNT < 32 => {
                            self.stretch::<S, FEW, WIDE>(simd, taps, first, row, column..end);
                            first += FEW;
                        }
                        Block::Few(taps) => {
                            self.stretch::<S, FEW, WIDER>(simd, taps, first, row, column..end);
                            first += FEW;
                        }
                    }
                }
            }
        }
    }
}

impl<F: Real> Correlate<'_, F> {
    /// Some outputs of a part of a row.
    #[inline(always)]
    fn stretch<S: Simd, const O: usize, const C: usize>(
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
                    _ => self.tile::<S, O, C>(simd, taps, first, row, column),
                };
        }
    }

    /// `O` outputs of `C` registers of a row.
    #[inline(always)]
    fn tile<S: Simd, const O: usize, const C: usize>(
        &mut self,
        simd: S,
        taps: &[[F; O]],
        first: usize,
        row: usize,
        column: usize,
    ) -> usize {
        let Bank { lines, columns, .. } = *self.bank;
        let lanes = F::lanes::<S>();
        let mut sums = [[F::splat(simd, F::zero()); C]; O];
        let inputs = taps.chunks_exact(lines * columns);
        for (taps, plane) in inputs.zip(self.source.data.chunks(self.source.plane)) {
            for (line, taps) in taps.chunks_exact(columns).enumerate() {
                let source = &plane[(row + line) * self.source.stride + column..];
                let source = &source[..columns - 1 + C * lanes];
                for (taps, window) in taps.iter().zip(source.windows(C * lanes)) {
                    let window = F::vectors::<S>(window);
                    let window: [_; C] = std::array::from_fn(|column| window[column]);
                    for output in 0..O {
                        let tap = F::splat(simd, taps[output]);
                        for column in 0..C {
                            sums[output][column] =
                                F::multiply_add(simd, window[column], tap, sums[output][column]);
                        }
                    }
                }
            }
        }
        let length = (self.width - column).min(C * lanes);
        let planes = self.out.chunks_exact_mut(self.height * self.width);
        for (plane, sums) in planes.skip(first).zip(sums) {
            let out = &mut plane[row * self.width + column..][..length];
            let mut parts = out.chunks_exact_mut(lanes);
            let mut sums = sums.into_iter();
            for (part, sum) in parts.by_ref().zip(sums.by_ref()) {
                F::vectors_mut::<S>(part)[0] = sum;
            }
            // What is left is shorter than a register.
            let rest = parts.into_remainder();
            if let Some(sum) = sums.next()
                && !rest.is_empty()
            {
                let mut whole = [F::zero(); LANES];
                F::vectors_mut::<S>(&mut whole)[0] = sum;
                rest.copy_from_slice(&whole[..rest.len()]);
            }
        }
        C
    }
}
