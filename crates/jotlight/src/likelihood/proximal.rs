//! The proximal map of −ℓ and the ADMM update that uses it.
//!
//! The map is separable: for each element, Newton's method finds the root of the derivative of
//! −ℓ(x) + ½ ρ (x − point)², which increases, between bounds that bisection tightens.

use rayon::prelude::*;

use super::chunk::{Chunk, ELEMENTS_PER_CHUNK, Element};
use super::{Readings, one_photon};
use crate::admm::{AdmmStep, check_penalty};
use crate::error::Result;

/// Relative size of the last Newton step of the proximal map. The remaining error is about 1e-10.
const PROXIMAL_TOLERANCE: f64 = 1e-5;

/// Relative size of the last Newton step inside ADMM. There x moves less and less, and the
/// remaining error, the square of the last step, is far below that move.
const ADMM_TOLERANCE: f64 = 1e-3;

/// Maximum number of Newton steps and bisections. Bisections alone would converge from any start.
pub(super) const MAX_ITERATIONS: usize = 200;

/// The parameters that the scalar proximal problems of all elements share.
#[derive(Clone, Copy)]
pub(super) struct ProximalProblem {
    /// ρ, the weight of the quadratic penalty.
    pub penalty: f64,
    /// The upper bound of x; the lower bound is 0.
    pub max_light: f64,
    /// The relative step size at which Newton's method stops.
    pub tolerance: f64,
}

impl ProximalProblem {
    /// Return the start of Newton's method: the guess, raised where the derivative is so steep that
    /// Newton steps would merely double x.
    #[inline(always)]
    pub fn start(&self, guess: f64) -> f64 {
        if guess < self.max_light {
            guess.max(1e-9 * self.max_light)
        } else {
            0.5 * self.max_light
        }
    }
}

impl Readings<'_> {
    /// Replace each value of `point` by the minimizer in [0, `max_light`] of
    /// −ℓ(x) + ½ `penalty` (x − point)². The search starts at `guess`.
    ///
    /// # Errors
    /// [`crate::error::Error::Shape`] when the arrays do not fit, [`crate::error::Error::Range`]
    /// for a penalty that is not above 0.
    pub fn proximal(
        &self,
        penalty: f64,
        max_light: f64,
        guess: &[f64],
        point: &mut [f64],
    ) -> Result<()> {
        self.check_length(point.len())?;
        self.check_length(guess.len())?;
        check_penalty(penalty)?;
        let problem = ProximalProblem {
            penalty,
            max_light,
            tolerance: PROXIMAL_TOLERANCE,
        };
        point
            .par_chunks_mut(ELEMENTS_PER_CHUNK)
            .zip(guess.par_chunks(ELEMENTS_PER_CHUNK))
            .enumerate()
            .for_each_init(Chunk::default, |chunk, (number, (point, guess))| {
                chunk.fill(self, number);
                self.solve_chunk(chunk, &problem, guess, point);
            });
        Ok(())
    }

    /// Update x and its dual by one ADMM iteration for −ℓ(x) subject to x = `light`, and return
    /// ‖light − x‖², the squared primal residual.
    ///
    /// # Errors
    /// [`crate::error::Error::Shape`] when the arrays do not fit, [`crate::error::Error::Range`]
    /// for a penalty that is not above 0.
    pub fn admm_update(
        &self,
        step: &AdmmStep,
        max_light: f64,
        light: &[f64],
        x: &mut [f64],
        dual: &mut [f64],
    ) -> Result<f64> {
        self.check_length(light.len())?;
        self.check_length(x.len())?;
        self.check_length(dual.len())?;
        check_penalty(step.penalty)?;
        let problem = ProximalProblem {
            penalty: step.penalty,
            max_light,
            tolerance: ADMM_TOLERANCE,
        };
        let squared_residuals: Vec<f64> = x
            .par_chunks_mut(ELEMENTS_PER_CHUNK)
            .zip(dual.par_chunks_mut(ELEMENTS_PER_CHUNK))
            .zip(light.par_chunks(ELEMENTS_PER_CHUNK))
            .enumerate()
            .map_init(
                || (Chunk::default(), Vec::new()),
                |(chunk, point), (number, ((x, dual), light))| {
                    chunk.fill(self, number);
                    for ((x, dual), &light) in x.iter().zip(dual.iter_mut()).zip(light) {
                        *dual += step.relax(light, *x);
                    }
                    point.clear();
                    point.extend_from_slice(dual);
                    self.solve_chunk(chunk, &problem, x, point);
                    let mut sum = 0.0;
                    for (((x, dual), &light), &minimizer) in
                        x.iter_mut().zip(dual).zip(light).zip(point.iter())
                    {
                        *x = minimizer;
                        *dual -= minimizer;
                        sum += (light - minimizer) * (light - minimizer);
                    }
                    sum
                },
            )
            .collect();
        Ok(squared_residuals.iter().sum())
    }

    fn solve_chunk(
        &self,
        chunk: &Chunk,
        problem: &ProximalProblem,
        guess: &[f64],
        point: &mut [f64],
    ) {
        if self.threshold.photons() == 1 {
            return one_photon::solve_proximal(chunk, problem, guess, point);
        }
        for (index, (point, &guess)) in point.iter_mut().zip(guess).enumerate() {
            *point = self.solve_element(&chunk.element(index), problem, *point, guess);
        }
    }

    /// Return the minimizer in [0, `max_light`] of −ℓ(x) + ½ ρ (x − point)² for one element.
    fn solve_element(
        &self,
        element: &Element,
        problem: &ProximalProblem,
        point: f64,
        guess: f64,
    ) -> f64 {
        let &ProximalProblem {
            penalty,
            max_light,
            tolerance,
        } = problem;
        if element.ones + element.zeros <= 0.0 {
            return point.clamp(0.0, max_light);
        }
        let derivatives = |x: f64| {
            let (gradient, curvature) = self.element_derivatives(element, x);
            (penalty * (x - point) - gradient, penalty + curvature)
        };
        let (mut low, mut high) = (0.0, max_light);
        // Whether the root is known to lie inside the bound. The ends are evaluated only on demand.
        let (mut above_zero, mut below_max) = (false, false);
        let mut x = problem.start(guess);
        for _ in 0..MAX_ITERATIONS {
            let (first, second) = derivatives(x);
            if first > 0.0 {
                (high, below_max) = (x, true);
            } else {
                (low, above_zero) = (x, true);
            }
            let mut next = x - first / second;
            if next >= high && !below_max {
                if derivatives(max_light).0 <= 0.0 {
                    return max_light;
                }
                below_max = true;
            } else if next <= low && !above_zero {
                if derivatives(0.0).0 >= 0.0 {
                    return 0.0;
                }
                above_zero = true;
            }
            let is_newton = next > low && next < high || next.to_bits() == x.to_bits();
            if !is_newton {
                next = 0.5 * (low + high);
            }
            let is_close = (next - x).abs() <= tolerance * next;
            if is_close && is_newton || high - low <= f64::EPSILON * high {
                return next;
            }
            x = next;
        }
        x
    }
}
