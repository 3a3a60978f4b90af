//! The derivatives of ℓ, the proximal map of −ℓ, and P⁻¹ for q = 1, where P(1, s) = 1 − e^(−s).
//!
//! The loops run over groups of a fixed number of elements, so the compiler vectorizes them. The
//! formulas are those of [`super::Threshold`] with q = 1. Only e^s − 1 and log(1 − p) are evaluated
//! differently.

use super::MIN_RATE;
use super::chunk::Chunk;
use super::proximal::{MAX_ITERATIONS, ProximalProblem};
use crate::cpu::levels;

/// The number of elements in a group.
pub(crate) const ELEMENTS_PER_GROUP: usize = 16;
pub(crate) type Group = [f64; ELEMENTS_PER_GROUP];

/// ln 2 is the sum of both numbers. The product of the first one and a small integer is exact.
const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

levels! {
    /// Write ∂ℓ/∂s and −∂²ℓ/∂s² of a chunk, as [`super::Readings::gradient_and_curvature`] does.
    pub(super) fn gradient_and_curvature(
        chunk: &Chunk, light: &[f64], gradient: &mut [f64], curvature: &mut [f64],
    ) = gradient_and_curvature_inlined;
    /// Replace `point` with the proximal map of −ℓ, as [`super::Readings::proximal`] does.
    pub(super) fn solve_proximal(
        chunk: &Chunk, problem: &ProximalProblem, guess: &[f64], point: &mut [f64],
    ) = solve_proximal_inlined;
}

#[inline(always)]
fn gradient_and_curvature_inlined(
    chunk: &Chunk,
    light: &[f64],
    gradient: &mut [f64],
    curvature: &mut [f64],
) {
    for start in (0..light.len()).step_by(ELEMENTS_PER_GROUP) {
        let elements = Elements::load(chunk, start);
        let (first, second) = elements.gradient_and_curvature(&load(light, start));
        store(&first, start, gradient);
        store(&second, start, curvature);
    }
}

#[inline(always)]
fn solve_proximal_inlined(
    chunk: &Chunk,
    problem: &ProximalProblem,
    guess: &[f64],
    point: &mut [f64],
) {
    for start in (0..point.len()).step_by(ELEMENTS_PER_GROUP) {
        let elements = Elements::load(chunk, start);
        let x = elements.minimize(problem, &load(point, start), &load(guess, start));
        store(&x, start, point);
    }
}

/// A group of elements. The elements beyond the end of the chunk have no readings.
struct Elements {
    ones: Group,
    zeros: Group,
    efficiency: Group,
    dark_counts: Group,
}

impl Elements {
    #[inline(always)]
    fn load(chunk: &Chunk, start: usize) -> Self {
        Self {
            ones: load(&chunk.ones, start),
            zeros: load(&chunk.zeros, start),
            efficiency: load(&chunk.efficiency, start),
            dark_counts: load(&chunk.dark_counts, start),
        }
    }

    /// Return ∂ℓ/∂s = η (L / (e^(η s + d) − 1) − (n − L)) and −∂²ℓ/∂s².
    #[inline(always)]
    fn gradient_and_curvature(&self, light: &Group) -> (Group, Group) {
        let mut rate = [0.0; ELEMENTS_PER_GROUP];
        for lane in 0..ELEMENTS_PER_GROUP {
            rate[lane] =
                (self.efficiency[lane] * light[lane] + self.dark_counts[lane]).max(MIN_RATE);
        }
        let exp_m1 = exp_m1(&rate);
        let (mut gradient, mut curvature) = ([0.0; ELEMENTS_PER_GROUP], [0.0; ELEMENTS_PER_GROUP]);
        for lane in 0..ELEMENTS_PER_GROUP {
            let score = 1.0 / exp_m1[lane];
            let efficiency = self.efficiency[lane];
            gradient[lane] = efficiency * (self.ones[lane] * score - self.zeros[lane]);
            curvature[lane] = efficiency * efficiency * (self.ones[lane] * (score * (score + 1.0)));
        }
        (gradient, curvature)
    }

    /// Return the minimizers in [0, `max_light`] of −ℓ(x) + ½ ρ (x − point)².
    ///
    /// Newton's method finds them. A bisection replaces each Newton step that would leave the
    /// interval in which the minimizer lies.
    #[inline(always)]
    fn minimize(&self, problem: &ProximalProblem, point: &Group, guess: &Group) -> Group {
        let ProximalProblem {
            penalty,
            max_light,
            tolerance,
        } = *problem;
        let (at_zero, _) = self.objective_derivatives(&[0.0; ELEMENTS_PER_GROUP], point, penalty);
        let (at_max, _) =
            self.objective_derivatives(&[max_light; ELEMENTS_PER_GROUP], point, penalty);
        let mut x = *guess;
        let mut done = [false; ELEMENTS_PER_GROUP];
        for lane in 0..ELEMENTS_PER_GROUP {
            // The derivative increases with x. If it is not negative at 0, the minimizer is 0. If
            // it is not positive at the maximum, the minimizer is the maximum.
            done[lane] = at_zero[lane] >= 0.0 || at_max[lane] <= 0.0;
            x[lane] = if at_zero[lane] >= 0.0 {
                0.0
            } else if at_max[lane] <= 0.0 {
                max_light
            } else {
                problem.start(x[lane])
            };
        }
        let (mut low, mut high) = ([0.0; ELEMENTS_PER_GROUP], [max_light; ELEMENTS_PER_GROUP]);
        for _ in 0..MAX_ITERATIONS {
            let (first, second) = self.objective_derivatives(&x, point, penalty);
            let mut any_left = false;
            for lane in 0..ELEMENTS_PER_GROUP {
                let is_above = first[lane] > 0.0;
                high[lane] = if is_above { x[lane] } else { high[lane] };
                low[lane] = if is_above { low[lane] } else { x[lane] };
                let step = x[lane] - first[lane] / second[lane];
                let is_newton =
                    step > low[lane] && step < high[lane] || step.to_bits() == x[lane].to_bits();
                let next = if is_newton {
                    step
                } else {
                    0.5 * (low[lane] + high[lane])
                };
                let is_close = is_newton && (next - x[lane]).abs() <= tolerance * next
                    || high[lane] - low[lane] <= f64::EPSILON * high[lane];
                x[lane] = if done[lane] { x[lane] } else { next };
                done[lane] |= is_close;
                any_left |= !done[lane];
            }
            if !any_left {
                break;
            }
        }
        x
    }

    /// Return the first and the second derivatives of −ℓ(x) + ½ `penalty` (x − point)².
    #[inline(always)]
    fn objective_derivatives(&self, x: &Group, point: &Group, penalty: f64) -> (Group, Group) {
        let (mut first, mut second) = self.gradient_and_curvature(x);
        for lane in 0..ELEMENTS_PER_GROUP {
            first[lane] = penalty * (x[lane] - point[lane]) - first[lane];
            second[lane] += penalty;
        }
        (first, second)
    }
}

/// Return the group that begins at `start`. Zeros replace the values beyond the end.
#[inline(always)]
fn load(values: &[f64], start: usize) -> Group {
    let values = &values[start..];
    if let Some(whole) = values.first_chunk() {
        return *whole;
    }
    let mut part = [0.0; ELEMENTS_PER_GROUP];
    part[..values.len()].copy_from_slice(values);
    part
}

#[inline(always)]
fn store(group: &Group, start: usize, out: &mut [f64]) {
    let out = &mut out[start..];
    let length = out.len().min(ELEMENTS_PER_GROUP);
    out[..length].copy_from_slice(&group[..length]);
}

/// Return e^x − 1 for x ≥ 0, accurate to a few units in the last place. An x above 709 is replaced
/// by 709.
///
/// If x = k ln 2 + r and |r| ≤ ½ ln 2, then e^x − 1 = 2^k (e^r − 1) + (2^k − 1). The Taylor series
/// of e^r − 1 is evaluated up to its 13th term.
#[inline(always)]
pub(crate) fn exp_m1(x: &Group) -> Group {
    // After this constant is added, the lowest bits of the sum contain the nearest integer.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    const SERIES: [f64; 12] = [
        1.0 / 6_227_020_800.0,
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
    ];
    let mut result = [0.0; ELEMENTS_PER_GROUP];
    for lane in 0..ELEMENTS_PER_GROUP {
        let x = x[lane].min(709.0);
        let shifted = x * std::f64::consts::LOG2_E + SHIFT;
        let k = shifted - SHIFT;
        let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
        let mut sum = SERIES[0];
        for coefficient in &SERIES[1..] {
            sum = sum * r + coefficient;
        }
        let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
        result[lane] = power * (r + r * r * sum) + (power - 1.0);
    }
    result
}

/// Return the rates −log(1 − p), accurate to a few units in the last place. A `probability` of 0 or
/// less, or NaN, maps to 0, and one of 1 or more to infinity.
///
/// If u = 1 − p = 2^k (1 + f) and 1 + f lies in [√½, √2), then log u = k ln 2 + log(1 + f). With
/// s = f / (2 + f), the series of log(1 + f) is 2s (1 + s²/3 + s⁴/5 + …). Its polynomial in s² is
/// that of the `log` function of FreeBSD. The rounding error of 1 − p is added in the end.
#[inline(always)]
pub(crate) fn inverse_detection_probability(probability: &Group) -> Group {
    const SQRT_HALF_BITS: u64 = 0x3fe6_a09e_667f_3bcd;
    const OFFSET: u64 = 2048;
    // The bits of this constant plus k are those of a number that is greater by k.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    const SERIES: [f64; 7] = [
        1.479_819_860_511_658_6e-1,
        1.531_383_769_920_937_3e-1,
        1.818_357_216_161_805e-1,
        2.222_219_843_214_978_4e-1,
        2.857_142_874_366_239e-1,
        3.999_999_999_940_942e-1,
        6.666_666_666_666_735e-1,
    ];
    let mut result = [0.0; ELEMENTS_PER_GROUP];
    for lane in 0..ELEMENTS_PER_GROUP {
        let p = probability[lane];
        let u = 1.0 - p;
        let error = ((1.0 - u) - p) / u;
        // The sum of k and this offset is positive, because u is not above 1.
        let bits = u.to_bits().wrapping_add(OFFSET << 52);
        let offset_k = bits.wrapping_sub(SQRT_HALF_BITS) >> 52;
        let k = f64::from_bits(SHIFT.to_bits() + offset_k) - (SHIFT + OFFSET as f64);
        let f = f64::from_bits(bits.wrapping_sub(offset_k << 52)) - 1.0;
        let s = f / (2.0 + f);
        let square = s * s;
        let mut sum = SERIES[0];
        for coefficient in &SERIES[1..] {
            sum = sum * square + coefficient;
        }
        let half_square = 0.5 * f * f;
        let small = s * (half_square + square * sum) + (k * LN_2_LOW + error);
        let rate = -(k * LN_2_HIGH - ((half_square - small) - f));
        let rate = if p >= 1.0 { f64::INFINITY } else { rate };
        result[lane] = if p > 0.0 { rate } else { 0.0 };
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_agree_with_the_standard_library() {
        let mut p = 1e-300;
        while p < 1.0 {
            for p in [p, 1.0 - p] {
                let rate = inverse_detection_probability(&[p; ELEMENTS_PER_GROUP])[0];
                let exact = -(-p).ln_1p();
                assert!(
                    rate.to_bits() == exact.to_bits()
                        || (rate - exact).abs() <= 4.0 * f64::EPSILON * exact,
                    "{p}: {rate} instead of {exact}"
                );
            }
            p *= 1.0 + 1e-2;
        }
        for (p, expected) in [
            (f64::NAN, 0.0),
            (-1.0, 0.0),
            (0.0, 0.0),
            (2.0, f64::INFINITY),
        ] {
            let rate = inverse_detection_probability(&[p; ELEMENTS_PER_GROUP])[0];
            assert!(rate.to_bits() == f64::to_bits(expected), "{p}: {rate}");
        }
    }

    #[test]
    fn exp_m1_agrees_with_the_standard_library() {
        let mut x = 1e-150;
        while x < 709.0 {
            let value = exp_m1(&[x; ELEMENTS_PER_GROUP])[0];
            let exact = x.exp_m1();
            assert!(
                (value - exact).abs() <= 4.0 * f64::EPSILON * exact,
                "{x}: {value} instead of {exact}"
            );
            x *= 1.0 + 1e-3;
        }
        assert!(exp_m1(&[1e4; ELEMENTS_PER_GROUP])[0] > 1e307);
    }
}
