//! The detection probability P(q, s) of a jot: its value, logarithm, derivatives, and inverse.
//!
//! A jot collects Y ~ Poisson(s) photons and reports b = [Y ≥ q] (paper, equation (3)). Therefore
//! P(b = 1) = P(q, s), the regularized lower incomplete gamma function. The paper writes p₁(s) for
//! P(b = 1) and p₀(s) for P(b = 0). Only `likelihood/one_photon.rs` repeats formulas of this
//! module: it evaluates the derivatives for q = 1 on groups of elements.

use crate::error::{Error, Result};

/// The threshold q of a jot: the jot reports 1 if at least q photons arrive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Threshold {
    q: f64,
    ln_factorial: f64,
}

impl Threshold {
    /// The maximum threshold. The series of this module converge quickly up to it, and rounding
    /// errors of ln q! remain small.
    pub const MAX_PHOTONS: u32 = 65_535;

    /// Return the threshold of `q` photons.
    ///
    /// # Errors
    /// [`Error::Range`] for q = 0, because such a jot would always report 1, and for a q above
    /// [`Threshold::MAX_PHOTONS`].
    pub fn new(q: u32) -> Result<Self> {
        if !(1..=Self::MAX_PHOTONS).contains(&q) {
            let expected = format!("1 to {} photons", Self::MAX_PHOTONS);
            return Err(Error::range("threshold", expected, q));
        }
        let q = f64::from(q);
        Ok(Self {
            q,
            ln_factorial: libm::lgamma(q + 1.0),
        })
    }

    /// Return q.
    #[must_use]
    pub fn photons(&self) -> u32 {
        self.q as u32
    }

    /// Return P(b = 1) = P(Y ≥ q) = P(q, s) for s ≥ 0 expected photons.
    ///
    /// The relative error is near the rounding error even if s is tiny.
    #[must_use]
    pub fn detection_probability(&self, s: f64) -> f64 {
        if self.is_one_photon() {
            -(-s).exp_m1()
        } else if s < self.q {
            self.poisson(s) * self.upper_sum(s)
        } else {
            1.0 - self.poisson(s) * self.lower_sum(s)
        }
    }

    /// Return P(b = 0) = P(Y < q) = 1 − P(q, s) for s ≥ 0 expected photons.
    ///
    /// The relative error is near the rounding error even if s is large.
    #[must_use]
    pub fn non_detection_probability(&self, s: f64) -> f64 {
        if self.is_one_photon() {
            (-s).exp()
        } else if s < self.q {
            1.0 - self.poisson(s) * self.upper_sum(s)
        } else {
            self.poisson(s) * self.lower_sum(s)
        }
    }

    /// Return dP(b = 1)/ds = s^(q−1) e^(−s) / (q−1)!.
    #[must_use]
    pub fn detection_derivative(&self, s: f64) -> f64 {
        if self.is_one_photon() {
            (-s).exp()
        } else {
            self.poisson(s) * self.q / s.max(f64::MIN_POSITIVE)
        }
    }

    /// Return d log P(b = 1)/ds for s > 0: the score of a one.
    ///
    /// It is finite even if P(b = 1) underflows.
    #[must_use]
    pub fn detection_score(&self, s: f64) -> f64 {
        self.detection_score_and_curvature(s).0
    }

    /// Return −d log P(b = 0)/ds for s > 0: the negated score of a zero.
    ///
    /// It is finite even if P(b = 0) underflows.
    #[must_use]
    pub fn non_detection_score(&self, s: f64) -> f64 {
        self.non_detection_score_and_curvature(s).0
    }

    /// Return log P(b = 1). It is −∞ for s = 0, and finite even if P(b = 1) underflows.
    #[must_use]
    pub fn log_detection_probability(&self, s: f64) -> f64 {
        if s <= 0.0 {
            f64::NEG_INFINITY
        } else if s >= self.q {
            (-self.non_detection_probability(s)).ln_1p()
        } else if self.is_one_photon() {
            self.detection_probability(s).ln()
        } else {
            self.ln_poisson(s) + self.upper_sum(s).ln()
        }
    }

    /// Return log P(b = 0). It is finite for a finite s even if P(b = 0) underflows.
    #[must_use]
    pub fn log_non_detection_probability(&self, s: f64) -> f64 {
        if self.is_one_photon() || s == f64::INFINITY {
            -s
        } else if s < self.q {
            (-self.detection_probability(s)).ln_1p()
        } else {
            self.ln_poisson(s) + self.lower_sum(s).ln()
        }
    }

    /// Return d log P(b = 1)/ds and −d² log P(b = 1)/ds² for s > 0.
    ///
    /// Both are positive, because log P is concave.
    ///
    /// If F is the score, the curvature is F² − F·((q − 1)/s − 1). For s < q, a sum of positive
    /// terms replaces this difference, so that nothing cancels.
    #[must_use]
    #[inline]
    pub fn detection_score_and_curvature(&self, s: f64) -> (f64, f64) {
        if self.is_one_photon() {
            let score = s.exp_m1().recip();
            return (score, score * (score + 1.0));
        }
        if s >= self.q {
            let score = self.detection_derivative(s) / self.detection_probability(s);
            return (score, score * (score + 1.0 - (self.q - 1.0) / s));
        }
        let (mut term, mut sum, mut weighted, mut k) = (1.0, 1.0, 1.0, 0.0);
        while term * (k + 1.0) > f64::EPSILON * 0.1 * sum {
            k += 1.0;
            term *= s / (self.q + k);
            sum += term;
            weighted += (k + 1.0) * term;
        }
        let score = self.q / s / sum;
        (score, score / s * (weighted / sum))
    }

    /// Return −d log P(b = 0)/ds and −d² log P(b = 0)/ds² for s > 0. Neither is negative.
    ///
    /// If G is the negated score, the curvature is G² + G·((q − 1)/s − 1). For s ≥ q, a sum of
    /// positive terms replaces this expression, so that nothing cancels.
    #[must_use]
    #[inline]
    pub fn non_detection_score_and_curvature(&self, s: f64) -> (f64, f64) {
        if self.is_one_photon() {
            return (1.0, 0.0);
        }
        if s < self.q {
            let score = self.detection_derivative(s) / self.non_detection_probability(s);
            return (score, score * (score + (self.q - 1.0) / s - 1.0));
        }
        let (mut term, mut sum, mut weighted, mut k) = (1.0, 1.0, 0.0, 0.0);
        while k < self.q && term * (k + 1.0) > f64::EPSILON * 0.1 * sum {
            k += 1.0;
            term *= (self.q - k) / s;
            sum += term;
            weighted += k * term;
        }
        let score = 1.0 / sum;
        (score, score * score * weighted / s)
    }

    /// Return the rate s with P(q, s) = `probability`: the inverse P⁻¹(q, ·).
    ///
    /// Probability 0 maps to 0, and probability 1 to infinity. For q = 1, the inverse is −log(1 −
    /// p) as in the paper's equation (5).
    #[must_use]
    pub fn inverse_detection_probability(&self, probability: f64) -> f64 {
        if probability <= 0.0 {
            return 0.0;
        }
        if probability >= 1.0 {
            return f64::INFINITY;
        }
        if self.is_one_photon() {
            return -(-probability).ln_1p();
        }
        if probability < self.detection_probability(self.q) {
            // ln P is a concave function of ln s. The start solves s^q / q! = p, so it lies to the
            // left of the root. Newton's method therefore rises to the root and never passes it.
            let target = probability.ln();
            let start = ((target + self.ln_factorial) / self.q).exp();
            iterate_to_fixed_point(start, |s| {
                let difference = target - self.ln_poisson(s) - self.upper_sum(s).ln();
                s * (difference / (s * self.detection_score(s))).exp()
            })
        } else {
            // ln(1 − P) is concave and decreasing. The first Newton step may pass the root. The
            // other steps then decrease to the root.
            let target = (1.0 - probability).ln();
            iterate_to_fixed_point(self.q, |s| {
                let difference = self.ln_poisson(s) + self.lower_sum(s).ln() - target;
                s + difference / self.non_detection_score(s)
            })
        }
    }

    pub(crate) fn is_one_photon(&self) -> bool {
        self.q < 1.5
    }

    /// Return P(Y = q) = s^q e^(−s) / q!.
    fn poisson(&self, s: f64) -> f64 {
        if s <= 0.0 || s.is_infinite() {
            0.0
        } else {
            self.ln_poisson(s).exp()
        }
    }

    fn ln_poisson(&self, s: f64) -> f64 {
        self.q * s.ln() - s - self.ln_factorial
    }

    /// Return P(Y ≥ q) / P(Y = q) = 1 + s/(q+1) + s²/((q+1)(q+2)) + …
    ///
    /// All terms are positive, so nothing cancels.
    fn upper_sum(&self, s: f64) -> f64 {
        let (mut term, mut sum, mut k) = (1.0, 1.0, self.q);
        while term > f64::EPSILON * 0.1 * sum {
            k += 1.0;
            term *= s / k;
            sum += term;
        }
        sum
    }

    /// Return P(Y < q) / P(Y = q) = q/s + q(q−1)/s² + …
    fn lower_sum(&self, s: f64) -> f64 {
        let (mut term, mut sum, mut k) = (1.0, 0.0, self.q);
        while k > 0.0 && term > f64::EPSILON * 0.1 * sum {
            term *= k / s;
            sum += term;
            k -= 1.0;
        }
        sum
    }
}

/// Apply `step` until the value changes only by rounding, but at most 100 times. Return the value.
fn iterate_to_fixed_point(start: f64, step: impl Fn(f64) -> f64) -> f64 {
    let mut s = start;
    for _ in 0..100 {
        let next = step(s);
        if (next - s).abs() <= 1e-15 * next {
            return next;
        }
        s = next;
    }
    s
}
