//! The gradient with respect to the taps of filters, equation (18).

use ndarray::{ArrayView3, ArrayViewMut4, Axis};

use super::direct::SPARE_ROWS;
use super::padded::Padded;
use crate::cpu::{self, Simd, WithSimd};
use crate::interrupt;
use crate::lanes::MAX_LANES;
use crate::numbers::Real;

/// The number of rows whose sum is computed in the type of the planes. Sums over more rows use
/// `f64`.
const BAND_ROWS: usize = 64;

impl<F: Real> Padded<F> {
    /// Add the gradient with respect to the taps to `tap_gradient`: equation (18).
    ///
    /// `gradient` is the gradient with respect to the outputs.
    pub fn add_tap_gradient(
        &self,
        gradient: ArrayView3<'_, F>,
        mut tap_gradient: ArrayViewMut4<'_, f64>,
    ) {
        let (_, height, width) = gradient.dim();
        let weight_stride = width.next_multiple_of(MAX_LANES);
        let mut sums = vec![0.0; self.taps.0 * self.taps.1];
        let mut weights = Vec::new();
        let outputs = gradient
            .axis_iter(Axis(0))
            .zip(tap_gradient.axis_iter_mut(Axis(0)));
        for (gradient, mut tap_gradient) in outputs {
            for first in (0..height).step_by(BAND_ROWS) {
                if interrupt::is_requested() {
                    return;
                }
                let band = first..(first + BAND_ROWS).min(height);
                weights.clear();
                weights.resize((band.len() + 2 * SPARE_ROWS) * weight_stride, F::zero());
                let inside = weights.chunks_exact_mut(weight_stride).skip(SPARE_ROWS);
                for (row, out) in band.zip(inside) {
                    for (out, &value) in out.iter_mut().zip(gradient.row(row)) {
                        *out = value;
                    }
                }
                for (channel, mut tap_gradient) in tap_gradient.outer_iter_mut().enumerate() {
                    sums.fill(0.0);
                    let start = channel * self.plane_stride + first * self.row_stride;
                    cpu::run(ShiftedProducts {
                        source: &self.data[start..],
                        source_stride: self.row_stride,
                        weights: &weights,
                        weight_stride,
                        shifts: self.taps,
                        sums: &mut sums,
                    });
                    // A convolution reads the taps in reverse order.
                    for (gradient, sum) in tap_gradient.iter_mut().zip(sums.iter().rev()) {
                        *gradient += sum;
                    }
                }
            }
        }
    }
}

/// The sums Σ weights · source for every shift of the source by rows and columns. They are added to
/// `sums`.
struct ShiftedProducts<'a, F> {
    source: &'a [F],
    source_stride: usize,
    /// Rows of `weight_stride` values. [`SPARE_ROWS`] rows of 0 precede and follow the others.
    weights: &'a [F],
    /// A multiple of [`MAX_LANES`].
    weight_stride: usize,
    /// The numbers of shifts by rows and by columns.
    shifts: (usize, usize),
    sums: &'a mut [f64],
}

impl<F: Real> WithSimd for ShiftedProducts<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        if const { S::REGISTER_COUNT < 32 } {
            self.run::<S, 3, 3>(simd);
        } else {
            self.run::<S, 4, 5>(simd);
        }
    }
}

impl<F: Real> ShiftedProducts<'_, F> {
    #[inline(always)]
    fn run<S: Simd, const R: usize, const C: usize>(&mut self, simd: S) {
        for row in (0..self.shifts.0).step_by(R) {
            for column in (0..self.shifts.1).step_by(C) {
                let tile = self.tile::<S, R, C>(simd, row, column);
                let rows = self.sums.chunks_exact_mut(self.shifts.1).skip(row);
                for (sums, tile) in rows.zip(tile) {
                    for (sum, tile) in sums[column..].iter_mut().zip(tile) {
                        *sum += F::reduce_sum(simd, tile).as_f64();
                    }
                }
            }
        }
    }

    /// Return the sums for `R` × `C` shifts, starting at the shift (`row_shift`, `column_shift`).
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(
        &self,
        simd: S,
        row_shift: usize,
        column_shift: usize,
    ) -> [[F::Vector<S>; C]; R] {
        let lanes = F::lanes::<S>();
        let rows = self.weights.len() / self.weight_stride - 2 * SPARE_ROWS;
        let mut sums = [[F::splat(simd, F::zero()); C]; R];
        for row in 0..rows + R - 1 {
            let source = &self.source[(row_shift + row) * self.source_stride + column_shift..];
            let weights: [&[F::Vector<S>]; R] = std::array::from_fn(|shift| {
                let row = SPARE_ROWS + row - shift;
                F::vectors::<S>(&self.weights[row * self.weight_stride..][..self.weight_stride])
            });
            for (step, start) in (0..self.weight_stride).step_by(lanes).enumerate() {
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
