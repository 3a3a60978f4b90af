//! Backpropagation through a spline: the gradients with respect to its argument and to its
//! coefficients, equations (14) to (19).

use super::evaluate::{BASIS, Spline, dot};
use crate::cpu::levels;
use crate::interrupt;
use crate::numbers::Real;

/// The number of interleaved partial sums. With several, an addition need not wait for the previous
/// one.
const INTERLEAVED: usize = 2;

/// The number of pixels whose sum is computed in the type of the planes. Sums over more pixels
/// use `f64`.
const BLOCK_PIXELS: usize = 4096;

impl<F: Real> Spline<F> {
    /// Replace the gradient with respect to φ(z) with the gradient with respect to z, and add the
    /// gradient with respect to the coefficients to `coefficient_gradient`.
    ///
    /// `inputs` holds the values z.
    pub(crate) fn pull_back(
        &self,
        inputs: &[F],
        gradient: &mut [F],
        coefficient_gradient: &mut [f64],
    ) {
        pull_back(self, inputs, gradient, coefficient_gradient);
    }

    #[inline(always)]
    fn pull_back_inlined(
        &self,
        inputs: &[F],
        gradient: &mut [F],
        coefficient_gradient: &mut [f64],
    ) {
        // The sums Σ gradient · (1, f, f², f³) over each knot interval determine the gradient with
        // respect to the coefficients. Neighboring pixels mostly share an interval, so their
        // additions alternate between partial sums.
        let mut partial_sums = vec![[F::zero(); 4]; INTERLEAVED * self.cubics.len()];
        let gradients = gradient.chunks_mut(BLOCK_PIXELS);
        for (inputs, gradient) in inputs.chunks(BLOCK_PIXELS).zip(gradients) {
            if interrupt::is_requested() {
                return;
            }
            for (pixel, (&z, gradient)) in inputs.iter().zip(gradient).enumerate() {
                let (interval, f) = self.locate(z);
                let interval = interval as usize;
                let sums = &mut partial_sums[interval * INTERLEAVED + pixel % INTERLEAVED];
                let squared = *gradient * f * f;
                let powers = [*gradient, *gradient * f, squared, squared * f];
                for k in 0..4 {
                    sums[k] += powers[k];
                }
                *gradient *= self.slope_in(interval, f, z);
            }
            let intervals = partial_sums.chunks_exact_mut(INTERLEAVED);
            for (interval, partial_sums) in intervals.enumerate() {
                let mut sums = [0.0; 4];
                for partial in partial_sums {
                    for (sum, part) in sums.iter_mut().zip(partial) {
                        *sum += std::mem::take(part).as_f64();
                    }
                }
                let gradients = coefficient_gradient[interval..].iter_mut();
                for (gradient, basis) in gradients.zip(BASIS) {
                    *gradient += dot(basis, sums);
                }
            }
        }
    }
}

levels! {
    fn pull_back[F: Real](
        spline: &Spline<F>, inputs: &[F], gradient: &mut [F], coefficient_gradient: &mut [f64],
    ) = Spline::pull_back_inlined;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_are_products_with_slopes_and_weights() {
        let spline = Spline::new(&[0.3, -1.2, 2.0, 0.7, 1.1, -0.4], -1.0, 0.5);
        let inputs: Vec<f64> = (0..5000).map(|k| f64::from(k) * 4e-4 - 1.2).collect();
        let output_gradient: Vec<f64> = (0..5000).map(|k| f64::from(k).sin()).collect();
        let (mut gradient, mut coefficient_gradient) = (output_gradient.clone(), [0.0; 6]);
        spline.pull_back(&inputs, &mut gradient, &mut coefficient_gradient);

        let mut expected = [0.0; 6];
        for ((&z, &outer), &found) in inputs.iter().zip(&output_gradient).zip(&gradient) {
            assert!((found - outer * spline.slope(z)).abs() < 1e-12);
            let (first, weights) = spline.weights(z);
            for (k, weight) in weights.iter().enumerate() {
                expected[first + k] += outer * weight;
            }
        }
        for (found, expected) in coefficient_gradient.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9);
        }
    }
}
