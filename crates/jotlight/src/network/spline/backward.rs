//! Backpropagation through a spline: the gradients with respect to its argument and to its
//! coefficients, equations (14) to (19).

use super::evaluate::{BASIS, Spline, dot};
#[cfg(target_arch = "x86_64")]
use super::registers::{IntervalSums, RegisterGradients};
#[cfg(target_arch = "x86_64")]
use crate::cpu;
use crate::cpu::levels;
use crate::interrupt;
use crate::numbers::Real;

/// The number of interleaved partial sums. With several, an addition need not wait for the previous
/// one.
const INTERLEAVED: usize = 4;

/// The number of pixels that are processed together.
const GROUP: usize = 64;

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
        #[cfg(target_arch = "x86_64")]
        if self.pull_back_in_registers(inputs, gradient, coefficient_gradient) {
            return;
        }
        pull_back(self, inputs, gradient, coefficient_gradient);
    }

    /// Do the same for splines with few knots by AVX-512, and return whether that was possible.
    #[cfg(target_arch = "x86_64")]
    fn pull_back_in_registers(
        &self,
        inputs: &[F],
        gradient: &mut [F],
        coefficient_gradient: &mut [f64],
    ) -> bool {
        let Some(gradient) = F::as_f32_slice(gradient) else {
            return false;
        };
        let gradients = gradient.chunks_mut(BLOCK_PIXELS);
        for (inputs, gradient) in inputs.chunks(BLOCK_PIXELS).zip(gradients) {
            if interrupt::is_requested() {
                return true;
            }
            let Some(spline) = self.in_registers() else {
                return false;
            };
            let mut sums = IntervalSums::default();
            cpu::run(RegisterGradients {
                spline,
                inputs,
                gradient,
                sums: &mut sums,
            });
            for (interval, sums) in sums.iter().take(self.cubics.len()).enumerate() {
                let sums = sums.map(|lanes| lanes.iter().map(|&sum| f64::from(sum)).sum());
                add_products(&mut coefficient_gradient[interval..], sums);
            }
        }
        true
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
            let (groups, rest) = inputs.as_chunks::<GROUP>();
            let (gradient_groups, gradient_rest) = gradient.as_chunks_mut::<GROUP>();
            for (inputs, gradient) in groups.iter().zip(gradient_groups) {
                self.pull_back_group(inputs, gradient, &mut partial_sums);
            }
            if !rest.is_empty() {
                // A gradient of 0 pads the last group.
                let (mut inputs, mut group) = ([F::zero(); GROUP], [F::zero(); GROUP]);
                inputs[..rest.len()].copy_from_slice(rest);
                group[..rest.len()].copy_from_slice(gradient_rest);
                self.pull_back_group(&inputs, &mut group, &mut partial_sums);
                gradient_rest.copy_from_slice(&group[..rest.len()]);
            }
            let intervals = partial_sums.chunks_exact_mut(INTERLEAVED);
            for (interval, partial_sums) in intervals.enumerate() {
                let mut sums = [0.0; 4];
                for partial in partial_sums {
                    for (sum, part) in sums.iter_mut().zip(partial) {
                        *sum += std::mem::take(part).as_f64();
                    }
                }
                add_products(&mut coefficient_gradient[interval..], sums);
            }
        }
    }
}

impl<F: Real> Spline<F> {
    /// Do the same for a group of pixels, and add to the sums of the knot intervals.
    ///
    /// The compiler vectorizes the first loop. The second one adds four numbers at a time.
    #[inline(always)]
    fn pull_back_group(
        &self,
        inputs: &[F; GROUP],
        gradient: &mut [F; GROUP],
        partial_sums: &mut [[F; 4]],
    ) {
        let mut intervals = [0; GROUP];
        let mut powers = [[F::zero(); GROUP]; 4];
        let mut positions = [F::zero(); GROUP];
        for pixel in 0..GROUP {
            let f;
            (intervals[pixel], f) = self.locate(inputs[pixel]);
            positions[pixel] = f;
            let squared = gradient[pixel] * f * f;
            powers[0][pixel] = gradient[pixel];
            powers[1][pixel] = gradient[pixel] * f;
            powers[2][pixel] = squared;
            powers[3][pixel] = squared * f;
        }
        for pixel in 0..GROUP {
            let interval = intervals[pixel] as usize;
            let sums = &mut partial_sums[interval * INTERLEAVED + pixel % INTERLEAVED];
            for k in 0..4 {
                sums[k] += powers[k][pixel];
            }
            gradient[pixel] *= self.slope_in(interval, positions[pixel], inputs[pixel]);
        }
    }
}

/// Add to the gradients of four coefficients: the sums Σ gradient · (1, f, f², f³) over a knot
/// interval, times the basis functions there.
fn add_products(gradients: &mut [f64], sums: [f64; 4]) {
    for (gradient, basis) in gradients.iter_mut().zip(BASIS) {
        *gradient += dot(basis, sums);
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
        let coefficients: Vec<f64> = (0..30).map(|k| (f64::from(k) * 0.7).sin()).collect();
        // With few knot intervals, which registers hold in f32, and with many.
        for number in [4, 6, 19, 20, 30] {
            let spacing = 1.8 / (number - 3) as f64;
            check_gradients::<f64>(&coefficients[..number], spacing, 1e-12);
            let coefficients: Vec<f32> = coefficients.iter().map(|&w| w as f32).collect();
            check_gradients::<f32>(&coefficients[..number], spacing as f32, 1e-5);
        }
    }

    fn check_gradients<F: Real>(coefficients: &[F], spacing: F, tolerance: f64) {
        let spline = Spline::new(coefficients, F::from_f64(-1.1), spacing);
        let inputs = (0..5001).map(|k| F::from_f64(f64::from(k) * 4e-4 - 1.2));
        let inputs: Vec<F> = inputs.collect();
        let output_gradient: Vec<F> = (0..5001).map(|k| F::from_f64(f64::from(k).sin())).collect();
        let mut gradient = output_gradient.clone();
        let mut coefficient_gradient = vec![0.0; coefficients.len()];
        spline.pull_back(&inputs, &mut gradient, &mut coefficient_gradient);

        let mut expected = vec![0.0; coefficients.len()];
        for ((&z, &outer), &found) in inputs.iter().zip(&output_gradient).zip(&gradient) {
            let slope = outer * spline.slope(z);
            assert!((found - slope).abs().as_f64() < tolerance * slope.abs().as_f64().max(1.0));
            let (first, weights) = spline.weights(z);
            for (k, weight) in weights.iter().enumerate() {
                expected[first + k] += (outer * *weight).as_f64();
            }
        }
        for (found, expected) in coefficient_gradient.iter().zip(expected) {
            assert!((found - expected).abs() < 1000.0 * tolerance);
        }
    }
}
