//! Sums over the numbers of photons that may be behind a reading.

use super::noise::{Level, Noise};
use super::poisson::ln_poisson;

/// Terms below this fraction of a sum are left out.
const NEGLIGIBLE: f64 = 1e-18;

/// Return log P(level) at a rate s: the sum over y of P(Y = y) P(level | y), Y ~ Poisson(s).
pub(super) fn ln_sum(noise: &Noise, level: Level, s: f64) -> f64 {
    let (mode, [zeroth, ..]) = sum_terms(noise, level, s);
    ln_poisson(mode as f64, s) + noise.ln_weight(level, mode) + zeroth.ln()
}

/// Return E[Y | level] / s, which is P(level | one more photon) / P(level), and
/// E[Y(Y − 1) | level] / s².
pub(super) fn moments(noise: &Noise, level: Level, s: f64) -> (f64, f64) {
    let (_, [zeroth, first, second]) = sum_terms(noise, level, s);
    (first / zeroth, second / zeroth)
}

/// Return the y of the largest term of a level, and the sums of t(y), t(y) y/s, and
/// t(y) y(y − 1)/s², where t(y) are the terms relative to it.
///
/// The terms rise to one maximum and fall, because both factors are log-concave. So the sum starts
/// at the maximum, and ends where terms are negligible.
fn sum_terms(noise: &Noise, level: Level, s: f64) -> (i64, [f64; 3]) {
    let (Level::Exactly(l) | Level::AtMost(l) | Level::AtLeast(l)) = level;
    let rate = s.min(1e15).floor() as i64;
    let near = match level {
        Level::Exactly(_) => l,
        Level::AtMost(_) => l.min(rate),
        Level::AtLeast(_) => l.max(rate),
    };
    // Ratios of successive terms, t(y + 1) / t(y).
    let ratio = |y: i64| s / (y + 1) as f64 * noise.weight_ratio(level, y);
    let mut mode = near.max(0);
    while ratio(mode) > 1.0 {
        mode += 1;
    }
    while mode > 0 && ratio(mode - 1) < 1.0 {
        mode -= 1;
    }
    let mut sums = Sums { s, sums: [0.0; 3] };
    sums.add(mode, 1.0);
    let (mut y, mut term) = (mode, 1.0);
    loop {
        term *= ratio(y);
        y += 1;
        if sums.add(y, term) && y >= 2 {
            break;
        }
    }
    (y, term) = (mode, 1.0);
    while y > 0 {
        term /= ratio(y - 1);
        y -= 1;
        if sums.add(y, term) {
            break;
        }
    }
    (mode, sums.sums)
}

/// The sums of t(y), t(y) y/s, and t(y) y(y − 1)/s².
struct Sums {
    s: f64,
    sums: [f64; 3],
}

impl Sums {
    /// Add a term, and return whether it was negligible in all sums.
    fn add(&mut self, y: i64, term: f64) -> bool {
        let y = y as f64;
        let first = term * y / self.s;
        let mut negligible = true;
        let terms = [term, first, first * (y - 1.0) / self.s];
        for (sum, term) in self.sums.iter_mut().zip(terms) {
            // Sums that are not numbers end too.
            let is_large = term > NEGLIGIBLE * *sum;
            negligible &= !is_large;
            *sum += term;
        }
        negligible
    }
}
