//! What one bit says of the light: P(b = 1), its logarithm and their slopes, and its inverse, for any threshold q.
//!
//! A jot sees Y ~ Poisson(s) photons and reports b = [Y ≥ q] (paper, equation (3)), so that
//! P(b = 1) = P(q, s), the regularised lower incomplete gamma function.

use crate::error::{Error, Result};

/// The threshold q of a jot: it reports 1 when at least q photons arrive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Threshold {
    q: f64,
    ln_factorial: f64,
}

impl Threshold {
    /// The threshold of `q` photons.
    ///
    /// # Errors
    /// [`Error::Range`] for q = 0: such a jot would always report 1.
    pub fn new(q: u32) -> Result<Self> {
        if q == 0 {
            return Err(Error::range("threshold", "at least 1 photon", q));
        }
        let q = f64::from(q);
        Ok(Self {
            q,
            ln_factorial: libm::lgamma(q + 1.0),
        })
    }

    /// q.
    #[must_use]
    pub fn photons(&self) -> u32 {
        self.q as u32
    }

    /// P(b = 1) = P(Y ≥ q) for s ≥ 0 expected photons; accurate for the smallest s too.
    #[must_use]
    pub fn fires(&self, s: f64) -> f64 {
        if self.one_photon() {
            -(-s).exp_m1()
        } else if s < self.q {
            self.poisson(s) * self.upper_sum(s)
        } else {
            1.0 - self.poisson(s) * self.lower_sum(s)
        }
    }

    /// P(b = 0) = P(Y < q) for s ≥ 0 expected photons; accurate for the largest s too.
    #[must_use]
    pub fn stays_dark(&self, s: f64) -> f64 {
        if self.one_photon() {
            (-s).exp()
        } else if s < self.q {
            1.0 - self.poisson(s) * self.upper_sum(s)
        } else {
            self.poisson(s) * self.lower_sum(s)
        }
    }

    /// dP(b = 1)/ds = s^(q−1) e^(−s) / (q−1)!.
    #[must_use]
    pub fn slope(&self, s: f64) -> f64 {
        if self.one_photon() {
            (-s).exp()
        } else {
            self.poisson(s) * self.q / s.max(f64::MIN_POSITIVE)
        }
    }

    /// d log P(b = 1)/ds for s > 0: what a jot that fired says of the light. Finite where P itself underflows.
    #[must_use]
    pub fn fired_score(&self, s: f64) -> f64 {
        self.fired_slopes(s).0
    }

    /// −d log P(b = 0)/ds for s > 0: what a jot that stayed dark says of the light. Finite where P(b = 0) underflows.
    #[must_use]
    pub fn dark_score(&self, s: f64) -> f64 {
        self.dark_slopes(s).0
    }

    /// log P(b = 1). Finite where P itself underflows; −∞ for s = 0.
    #[must_use]
    pub fn log_fires(&self, s: f64) -> f64 {
        if s <= 0.0 {
            f64::NEG_INFINITY
        } else if self.one_photon() {
            if s < 1.0 {
                (-(-s).exp_m1()).ln()
            } else {
                (-(-s).exp()).ln_1p()
            }
        } else if s < self.q {
            self.ln_poisson(s) + self.upper_sum(s).ln()
        } else {
            (-self.poisson(s) * self.lower_sum(s)).ln_1p()
        }
    }

    /// log P(b = 0). Finite where P(b = 0) underflows.
    #[must_use]
    pub fn log_stays_dark(&self, s: f64) -> f64 {
        if self.one_photon() {
            -s
        } else if s < self.q {
            (-self.poisson(s) * self.upper_sum(s)).ln_1p()
        } else {
            self.ln_poisson(s) + self.lower_sum(s).ln()
        }
    }

    /// d log P(b = 1)/ds and −d² log P(b = 1)/ds², both above 0 as log P is concave, for s > 0.
    ///
    /// With the score F the curvature is F² − F·((q − 1)/s − 1). Below s = q that difference is written as a sum of positive
    /// terms, so that nothing cancels.
    #[must_use]
    #[inline]
    pub fn fired_slopes(&self, s: f64) -> (f64, f64) {
        if self.one_photon() {
            let score = s.exp_m1().recip();
            return (score, score * (score + 1.0));
        }
        if s >= self.q {
            let score = self.slope(s) / self.fires(s);
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

    /// −d log P(b = 0)/ds and −d² log P(b = 0)/ds², neither below 0, for s > 0.
    ///
    /// With the score G the curvature is G² + G·((q − 1)/s − 1), above s = q again as a sum of positive terms.
    #[must_use]
    #[inline]
    pub fn dark_slopes(&self, s: f64) -> (f64, f64) {
        if self.one_photon() {
            return (1.0, 0.0);
        }
        if s < self.q {
            let score = self.slope(s) / self.stays_dark(s);
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

    /// The s at which P(b = 1) is `probability`: P⁻¹(q, ·). 0 gives 0, 1 gives infinity.
    #[must_use]
    pub fn rate(&self, probability: f64) -> f64 {
        if probability <= 0.0 {
            return 0.0;
        }
        if probability >= 1.0 {
            return f64::INFINITY;
        }
        if self.one_photon() {
            return -(-probability).ln_1p();
        }
        if probability < self.fires(self.q) {
            // ln P is concave in ln s, and the first term of the tail, s^q / q! = p, lies left of the root: Newton's steps
            // rise to the root and never pass it.
            let target = probability.ln();
            let start = ((target + self.ln_factorial) / self.q).exp();
            newton(start, |s| {
                let short = target - self.ln_poisson(s) - self.upper_sum(s).ln();
                s * (short / (s * self.fired_score(s))).exp()
            })
        } else {
            // ln(1 − P) is concave and falls: the first step passes the root, the others come back to it.
            let target = (1.0 - probability).ln();
            newton(self.q, |s| {
                s + (self.ln_poisson(s) + self.lower_sum(s).ln() - target) / self.dark_score(s)
            })
        }
    }

    fn one_photon(&self) -> bool {
        self.q < 1.5
    }

    /// P(Y = q).
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

    /// P(Y ≥ q) / P(Y = q) = 1 + s/(q+1) + s²/((q+1)(q+2)) + …: all terms positive, so nothing cancels.
    fn upper_sum(&self, s: f64) -> f64 {
        let (mut term, mut sum, mut k) = (1.0, 1.0, self.q);
        while term > f64::EPSILON * 0.1 * sum {
            k += 1.0;
            term *= s / k;
            sum += term;
        }
        sum
    }

    /// P(Y < q) / P(Y = q) = q/s + q(q−1)/s² + ….
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

/// Iterates `step` until it stands still.
fn newton(start: f64, step: impl Fn(f64) -> f64) -> f64 {
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
