//! The parameters that the ADMM updates of the likelihood and of the total variation share.
//!
//! An update is one iteration of the scaled, over-relaxed form of ADMM for a term f(x) subject to
//! x = A c. It sets x to the proximal map of f/ρ at (relaxed A c + dual). Then it sets the dual to
//! (relaxed A c + dual − x).

use crate::error::Result;
use crate::values::check_positive;

/// The parameters of one ADMM update.
#[derive(Clone, Copy, Debug)]
pub struct AdmmStep {
    /// ρ, the weight of the quadratic penalty ½ ρ ‖A c − x + dual‖².
    pub penalty: f64,
    /// The over-relaxation factor. At 1, the update uses A c itself. Above 1, it extrapolates from
    /// x beyond A c.
    pub relaxation: f64,
}

impl AdmmStep {
    pub(crate) fn check(&self) -> Result<()> {
        check_positive("penalty", self.penalty)?;
        check_positive("relaxation", self.relaxation)
    }

    /// Return the relaxed value: `target`, which is the new value of A c, extrapolated from `x`.
    pub(crate) fn relax(&self, target: f64, x: f64) -> f64 {
        self.relaxation * target + (1.0 - self.relaxation) * x
    }
}
