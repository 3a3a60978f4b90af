//! The pointwise nonlinearity: a cubic B-spline on even knots.

use ndarray::ArrayView1;

/// φ(z) = Σ_k w_k β3((z − start)/Δ − (k − 1)): equations (8) and (10), on \[start, start + (N_w − 3) Δ\]; constant outside of it.
///
/// `Differs from the paper:` the knots begin at `start` and not at 0, so that all N_w functions lie over the range of the input.
#[derive(Clone, Copy, Debug)]
pub struct Spline<'a> {
    coefficients: ArrayView1<'a, f32>,
    start: f32,
    inverse_spacing: f32,
    hull: (f32, f32),
}

impl<'a> Spline<'a> {
    pub(super) fn new(coefficients: ArrayView1<'a, f32>, start: f32, spacing: f32) -> Self {
        let hull = coefficients
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &w| {
                (low.min(w), high.max(w))
            });
        Self {
            coefficients,
            start,
            inverse_spacing: 1.0 / spacing,
            hull,
        }
    }

    /// φ(z), never outside of the coefficients' hull, not even by rounding.
    #[must_use]
    pub fn value(&self, z: f32) -> f32 {
        let intervals = self.coefficients.len() - 3;
        let place = ((z - self.start) * self.inverse_spacing).clamp(0.0, intervals as f32);
        let first = (place as usize).min(intervals - 1);
        basis(place - first as f32)
            .iter()
            .enumerate()
            .map(|(k, weight)| weight * self.coefficients[first + k])
            .sum::<f32>()
            .clamp(self.hull.0, self.hull.1)
    }
}

/// The four cubic B-splines that are not zero at distance `f` in \[0, 1\] past a knot.
fn basis(f: f32) -> [f32; 4] {
    let g = 1.0 - f;
    [
        g * g * g / 6.0,
        (f * f * (3.0 * f - 6.0) + 4.0) / 6.0,
        (g * g * (3.0 * g - 6.0) + 4.0) / 6.0,
        f * f * f / 6.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn equal_coefficients_make_a_constant() {
        let coefficients = array![2.0, 2.0, 2.0, 2.0, 2.0, 2.0];
        let spline = Spline::new(coefficients.view(), -1.0, 0.5);
        for z in [-9.0, -1.0, -0.3, 0.0, 0.5, 9.0] {
            assert!((spline.value(z) - 2.0).abs() < 1e-6);
        }
    }

    #[test]
    fn even_coefficients_make_a_line() {
        let coefficients = array![-1.0, 0.0, 1.0, 2.0, 3.0];
        let spline = Spline::new(coefficients.view(), 10.0, 2.0);
        for z in [10.0f32, 10.5, 12.0, 13.7, 14.0] {
            assert!((spline.value(z) - (z - 10.0) / 2.0).abs() < 1e-6);
        }
    }
}
