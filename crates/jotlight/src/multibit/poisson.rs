//! The Poisson distribution with all digits, and its quantiles.

use std::f64::consts::PI;

/// log(y!) − log(√(2πy) (y/e)^y) for y below its length, and for larger y the series of Stirling.
///
/// Loader (2000), *Fast and accurate computation of binomial probabilities*.
fn stirling_error(y: f64) -> f64 {
    if y < 16.0 {
        return libm::lgamma(y + 1.0) - (y + 0.5) * y.ln() + y - 0.5 * (2.0 * PI).ln();
    }
    let square = y * y;
    let tail = (1.0 / 1260.0 - (1.0 / 1680.0 - 1.0 / 1188.0 / square) / square) / square;
    (1.0 / 12.0 - (1.0 / 360.0 - tail) / square) / y
}

/// Return y log(y/s) + s − y, the deviance of a Poisson count, without cancellation.
fn deviance(y: f64, s: f64) -> f64 {
    let difference = y - s;
    if difference.abs() >= 0.1 * (y + s) {
        return y * (y / s).ln() - difference;
    }
    let ratio = difference / (y + s);
    let mut sum = difference * ratio;
    let mut term = 2.0 * y * ratio;
    let square = ratio * ratio;
    let mut odd = 1.0;
    while term.abs() > f64::EPSILON * 0.1 * sum.abs() {
        term *= square;
        odd += 2.0;
        sum += term / odd;
    }
    sum
}

/// Return log P(Y = y) for Y ~ Poisson(s), with a whole number y of 0 or more, and s > 0.
pub(super) fn ln_poisson(y: f64, s: f64) -> f64 {
    if y == 0.0 {
        return -s;
    }
    -stirling_error(y) - deviance(y, s) - 0.5 * (2.0 * PI * y).ln()
}

/// The rate below which quantiles are found from 0 on, and above which from the mean on.
const SMALL_RATE: f64 = 16.0;

/// Return the largest y with P(Y ≥ y) > u, where Y ~ Poisson(s): a random number if u is uniform.
///
/// The result is [Y ≥ q] = [u < P(Y ≥ q)] for each q, so readings of several bits agree with the
/// bits of all thresholds. A result above `highest` means that Y is about that or more.
pub(super) fn poisson_quantile(u: f64, s: f64, highest: f64) -> f64 {
    if s <= 0.0 {
        return 0.0;
    }
    if s - 12.0 * s.sqrt() > highest {
        return highest + 1.0;
    }
    let (mut y, mut probability, mut upper) = if s < SMALL_RATE {
        (0.0, (-s).exp(), 1.0)
    } else {
        let mode = s.floor();
        let probability = ln_poisson(mode, s).exp();
        (mode, probability, probability * upper_sum(mode, s))
    };
    // `upper` is P(Y ≥ y), and `probability` is P(Y = y).
    while u >= upper && y > 0.0 {
        probability *= y / s;
        y -= 1.0;
        upper += probability;
    }
    while u < upper - probability && y <= highest {
        upper -= probability;
        y += 1.0;
        probability *= s / y;
    }
    y
}

/// Return P(Y ≥ y) / P(Y = y).
fn upper_sum(y: f64, s: f64) -> f64 {
    let (mut term, mut sum, mut count) = (1.0, 1.0, y);
    while term > f64::EPSILON * 0.1 * sum {
        count += 1.0;
        term *= s / count;
        sum += term;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::Threshold;

    #[test]
    fn quantiles_are_those_of_all_thresholds() -> crate::error::Result<()> {
        for s in [0.01, 0.7, 3.0, 15.9, 16.1, 40.0, 300.0] {
            for number in 0..400 {
                let u = (f64::from(number) + 0.37) / 400.0;
                let y = poisson_quantile(u, s, 1e4);
                if y > 0.0 {
                    assert!(u < Threshold::new(y as u32)?.detection_probability(s));
                }
                assert!(u >= Threshold::new(y as u32 + 1)?.detection_probability(s));
            }
        }
        Ok(())
    }
}
