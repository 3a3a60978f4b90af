//! The problem that the proximal map solves for each element.

use crate::error::{Error, Result};

/// The maximum of the upper bound of x. A bisection adds two values of x, and the sum must be finite.
const MAX_LIGHT: f64 = 1e300;

/// The maximum number of steps. It suffices even if every step is a bisection.
pub(super) const MAX_ITERATIONS: usize = 200;

/// The parameters that the proximal problems of all elements share.
#[derive(Clone, Copy)]
pub(super) struct ProximalProblem {
    /// ρ, the weight of the quadratic penalty ½ ρ (x − point)².
    pub penalty: f64,
    /// The upper bound of x; the lower bound is 0.
    pub max_light: f64,
    /// The relative step size at which Newton's method stops.
    pub tolerance: f64,
}

impl ProximalProblem {
    pub fn new(penalty: f64, max_light: f64, tolerance: f64) -> Result<Self> {
        if !(0.0..=MAX_LIGHT).contains(&max_light) {
            return Err(Error::range(
                "maximum of the light",
                "0 to 1e300",
                max_light,
            ));
        }
        Ok(Self {
            penalty,
            max_light,
            tolerance,
        })
    }

    /// Return the start of Newton's method. It is the guess, unless the guess is at a bound.
    ///
    /// Near 0 the derivative may be so steep that a Newton step only doubles x. Therefore the start
    /// is not below 10⁻⁹ times the upper bound.
    #[inline(always)]
    pub fn start(&self, guess: f64) -> f64 {
        if guess < self.max_light {
            guess.max(1e-9 * self.max_light)
        } else {
            0.5 * self.max_light
        }
    }
}
