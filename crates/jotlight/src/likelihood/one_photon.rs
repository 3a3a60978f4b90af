//! The derivatives of ℓ and the proximal map of −ℓ for q = 1, where P(1, s) = 1 − e^(−s).
//!
//! The loops run over groups of a fixed number of elements, so the compiler vectorizes them. The
//! formulas are those of [`super::Threshold`] with q = 1. Only e^s − 1 is evaluated differently.

use super::MIN_RATE;
use super::chunk::Chunk;
use super::proximal_problem::{MAX_ITERATIONS, ProximalProblem};
use crate::cpu::levels;
use crate::elementary::{ELEMENTS_PER_GROUP, Group, exp_m1};

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
