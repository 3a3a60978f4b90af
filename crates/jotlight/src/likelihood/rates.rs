//! The rates of many detection probabilities for a threshold above 1, from a table.

use std::sync::Arc;

use super::Threshold;
use crate::kept::Kept;

/// The distance of neighboring nodes. The interpolated rates have a relative error below 2e-9,
/// which is far less than the rounding of an `f32`.
const SPACING: f64 = 1.0 / 16.0;

/// The first node. The smallest `f32` above 0 has the logit −103.3.
const FIRST: f64 = -104.0;

/// The number of intervals. The largest `f32` below 1 has the logit 16.6.
const INTERVALS: usize = 121 * 16;

/// The logarithm of the rate P⁻¹(q, p) as a cubic function of the logit log(p / (1 − p)) in each
/// interval of a table.
///
/// It is smooth in both tails. Newton's method would take 0.6 µs for each probability.
pub(crate) struct Rates {
    /// The logarithms of the rates, and [`SPACING`] times their derivatives by the logit.
    nodes: Vec<[f64; 2]>,
}

static TABLES: Kept<Rates> = Kept::new();

impl Rates {
    /// Return the table of a threshold above 1. Tables of the last thresholds are kept.
    pub(crate) fn of(threshold: &Threshold) -> Arc<Self> {
        TABLES.get(threshold.photons(), || Self::new(threshold))
    }

    fn new(threshold: &Threshold) -> Self {
        let nodes = (0..=INTERVALS)
            .map(|node| node_at(threshold, FIRST + node as f64 * SPACING))
            .collect();
        Self { nodes }
    }

    /// Return P⁻¹(q, p) of a probability that is an `f32`.
    #[inline]
    pub(crate) fn rate(&self, probability: f64) -> f64 {
        if probability <= 0.0 {
            return 0.0;
        }
        if probability >= 1.0 {
            return f64::INFINITY;
        }
        let place = ((probability / (1.0 - probability)).ln() - FIRST) / SPACING;
        let interval = (place.max(0.0) as usize).min(INTERVALS - 1);
        let t = place - interval as f64;
        let [[left, left_slope], [right, right_slope]] =
            [self.nodes[interval], self.nodes[interval + 1]];
        // The cubic function with these values and derivatives at both nodes.
        let rise = right - left;
        let quadratic = 3.0 * rise - 2.0 * left_slope - right_slope;
        let cubic = left_slope + right_slope - 2.0 * rise;
        (left + t * (left_slope + t * (quadratic + t * cubic))).exp()
    }
}

/// Return the logarithm of the rate at a logit, and [`SPACING`] times its derivative.
fn node_at(threshold: &Threshold, logit: f64) -> [f64; 2] {
    let (p, complement) = (1.0 / (1.0 + (-logit).exp()), 1.0 / (1.0 + logit.exp()));
    let rate = threshold.inverse_detection_probability(p);
    // dp = p (1 − p) d(logit), and the scores are the derivatives of log p and −log(1 − p).
    let slope = if logit < 0.0 {
        complement / threshold.detection_score(rate)
    } else {
        p / threshold.non_detection_score(rate)
    };
    [rate.ln(), SPACING * slope / rate]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    #[test]
    fn rates_are_those_of_newtons_method() -> Result<()> {
        for photons in [2, 3, 9, 200, 65_535] {
            let threshold = Threshold::new(photons)?;
            let rates = Rates::of(&threshold);
            let mut probability = f32::from_bits(1);
            while probability < 1.0 {
                let exact = threshold.inverse_detection_probability(f64::from(probability));
                let found = rates.rate(f64::from(probability));
                let relative = (found / exact - 1.0).abs();
                assert!(
                    relative < 3e-9,
                    "{photons}, {probability}: {found}, {exact}"
                );
                probability = (probability * 1.07).max(f32::from_bits(probability.to_bits() + 1));
            }
            let last = f64::from(1.0f32.next_down());
            let exact = threshold.inverse_detection_probability(last);
            assert!((rates.rate(last) / exact - 1.0).abs() < 3e-9);
            let limits = [0.0, -0.1, 1.0].map(|p| rates.rate(p).to_bits());
            assert_eq!(limits, [0.0, 0.0, f64::INFINITY].map(f64::to_bits));
        }
        Ok(())
    }

    #[test]
    fn each_threshold_has_its_table() -> Result<()> {
        for photons in [2, 3, 2] {
            let threshold = Threshold::new(photons)?;
            let (first, second) = (Rates::of(&threshold), Rates::of(&threshold));
            assert_eq!(first.nodes, second.nodes);
            let exact = threshold.inverse_detection_probability(0.3);
            assert!((first.rate(0.3) / exact - 1.0).abs() < 3e-9);
        }
        Ok(())
    }
}
