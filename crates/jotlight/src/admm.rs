//! Parameters that the ADMM updates of the likelihood and of the total variation share.
//!
//! Both are one iteration of the scaled, over-relaxed form of ADMM for f(x) subject to x = A c:
//! x ← prox of f at (relaxed A c + dual), then dual ← relaxed A c + dual − x.

use crate::error::{Error, Result};

/// The parameters of one ADMM update.
#[derive(Clone, Copy, Debug)]
pub struct AdmmStep {
    /// ρ, the weight of the penalty ½ ρ ‖A c − x + dual‖².
    pub penalty: f64,
    /// The over-relaxation factor: 1 uses A c itself, a value above 1 extrapolates beyond it.
    pub relaxation: f64,
}

impl AdmmStep {
    /// Return the over-relaxed value between `x` and the new value `target` of A c.
    pub(crate) fn relax(&self, target: f64, x: f64) -> f64 {
        self.relaxation * target + (1.0 - self.relaxation) * x
    }
}

pub(crate) fn check_penalty(penalty: f64) -> Result<()> {
    if penalty > 0.0 && penalty.is_finite() {
        Ok(())
    } else {
        Err(Error::range("penalty", "a finite number above 0", penalty))
    }
}
