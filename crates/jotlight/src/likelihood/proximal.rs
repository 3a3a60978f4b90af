//! The proximal map of −ℓ, and the ADMM update that uses it.
//!
//! Each element is a separate problem: to minimize −ℓ(x) + ½ ρ (x − point)². The derivative of this
//! function increases with x, and Newton's method finds its root. A bisection replaces each Newton
//! step that would leave the interval in which the root lies.

use rayon::prelude::*;

use super::chunk::{Chunk, ELEMENTS_PER_CHUNK, Element};
use super::proximal_problem::{MAX_ITERATIONS, ProximalProblem};
use super::{Readings, one_photon};
use crate::admm::AdmmStep;
#[cfg(doc)]
use crate::error::Error;
use crate::error::{Result, check_shape};
use crate::images::for_each_image;
use crate::interrupt;
use crate::values::{check_numbers, check_positive};

/// The maximum relative size of the last Newton step of the proximal map. The error of the result
/// is then about the square of this size, 1e-10.
const PROXIMAL_TOLERANCE: f64 = 1e-5;

/// The maximum relative size of the last Newton step in an ADMM update. The error of the result is
/// about the square of this size, and thus far smaller than the change of x in the update.
const ADMM_TOLERANCE: f64 = 1e-3;

impl Readings<'_> {
    /// Replace each value of `point` with the minimizer in [0, `max_light`] of
    /// −ℓ(x) + ½ `penalty` (x − point)². The search starts at `guess`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a penalty
    /// that is not above 0, for a `max_light` outside 0 to 10³⁰⁰, or for a point that is NaN.
    pub fn proximal(
        &self,
        penalty: f64,
        max_light: f64,
        guess: &[f64],
        point: &mut [f64],
    ) -> Result<()> {
        check_shape("point", self.len(), point.len())?;
        check_shape("guess", self.len(), guess.len())?;
        check_positive("penalty", penalty)?;
        check_numbers("point", point)?;
        let problem = ProximalProblem::new(penalty, max_light, PROXIMAL_TOLERANCE)?;
        point
            .par_chunks_mut(ELEMENTS_PER_CHUNK)
            .zip(guess.par_chunks(ELEMENTS_PER_CHUNK))
            .enumerate()
            .for_each_init(Chunk::default, |chunk, (number, (point, guess))| {
                if interrupt::is_requested() {
                    return;
                }
                chunk.fill(self, number);
                self.solve_chunk(chunk, &problem, guess, point);
            });
        Ok(())
    }

    /// Update `x` and its dual by one ADMM iteration for −ℓ(x) subject to x = `light`. Return the
    /// squared primal residual ‖light − x‖² of each image.
    ///
    /// The images have the same number of elements, and a step each.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a penalty or
    /// a relaxation that is not a finite number above 0, for a `max_light` outside 0 to 10³⁰⁰, or for
    /// light or a dual that is NaN.
    pub fn admm_update(
        &self,
        steps: &[AdmmStep],
        max_light: f64,
        light: &[f64],
        x: &mut [f64],
        dual: &mut [f64],
    ) -> Result<Vec<f64>> {
        check_shape("light", self.len(), light.len())?;
        check_shape("x", self.len(), x.len())?;
        check_shape("dual", self.len(), dual.len())?;
        let size = self.elements_of_image(steps.len())?;
        // Images without elements have no chunks.
        let parts = x.chunks_mut(size.max(1)).zip(dual.chunks_mut(size.max(1)));
        for_each_image(
            steps.iter().zip(parts).enumerate(),
            |(image, (step, (x, dual)))| {
                let elements = image * size..(image + 1) * size;
                let readings = self.part(elements.clone());
                readings.update_image(step, max_light, &light[elements], x, dual)
            },
        )
    }

    /// Update `x` and its dual for one image, and return its squared primal residual.
    fn update_image(
        &self,
        step: &AdmmStep,
        max_light: f64,
        light: &[f64],
        x: &mut [f64],
        dual: &mut [f64],
    ) -> Result<f64> {
        step.check()?;
        check_numbers("light", light)?;
        check_numbers("dual", dual)?;
        let problem = ProximalProblem::new(step.penalty, max_light, ADMM_TOLERANCE)?;
        let squared_residuals: Vec<f64> = x
            .par_chunks_mut(ELEMENTS_PER_CHUNK)
            .zip(dual.par_chunks_mut(ELEMENTS_PER_CHUNK))
            .zip(light.par_chunks(ELEMENTS_PER_CHUNK))
            .enumerate()
            .map_init(
                || (Chunk::default(), Vec::new()),
                |(chunk, point), (number, ((x, dual), light))| {
                    if interrupt::is_requested() {
                        return 0.0;
                    }
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

    /// Replace each value of `point` with the minimizer for its element of a chunk.
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
            if interrupt::is_requested() {
                return;
            }
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
        // Whether it is known that the root is above 0 and below the maximum. The derivative at
        // these bounds is computed only if a step reaches them.
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
