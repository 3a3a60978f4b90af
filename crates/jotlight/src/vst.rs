//! The variance-stabilizing Anscombe transform of binomial counts, and its inverses (paper,
//! equations (6) and (7)).
//!
//! The noise of transformed counts is approximately normal. Its standard deviation is 1/2,
//! whatever the light.

use ndarray::{ArrayView1, ArrayViewMut1, Axis, Zip};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::interrupt;
use crate::values::Values;

/// The number of values that a thread maps before it asks whether the call is interrupted.
const VALUES_PER_CHUNK: usize = 1 << 10;

/// Return T(`count`) for K = `trials` readings per pixel, a real number: equation (6).
#[must_use]
pub fn transform(count: f64, trials: f64) -> f64 {
    // Counts are float32. If K is above 2²⁴, rounding may raise a count above K.
    let fraction = ((count + 0.375) / (trials + 0.75)).min(1.0);
    (trials + 0.5).sqrt() * fraction.sqrt().asin()
}

/// Return T⁻¹(`z`) for K = `trials` readings per pixel, a real number: equation (7).
///
/// `Differs from the paper:` the angle z / √(K + 1/2) is clipped to [0, π/2], and the result to
/// [0, K]. It is NaN if K is negative or NaN.
#[must_use]
pub fn algebraic_inverse(z: f64, trials: f64) -> f64 {
    let angle = (z / (trials + 0.5).sqrt()).clamp(0.0, std::f64::consts::FRAC_PI_2);
    let count = (trials + 0.75) * angle.sin().powi(2) - 0.375;
    if trials >= 0.0 {
        count.clamp(0.0, trials)
    } else {
        f64::NAN
    }
}

/// The Anscombe transform of the number of ones among K readings, and its expectation.
#[derive(Clone, Copy, Debug)]
pub struct Anscombe {
    trials: f64,
}

impl Anscombe {
    /// Return the transform for K = `trials` readings per pixel.
    ///
    /// # Errors
    /// [`Error::Range`] for K = 0.
    pub fn new(trials: u32) -> Result<Self> {
        if trials == 0 {
            return Err(Error::range("trials per pixel", "at least 1", trials));
        }
        Ok(Self {
            trials: f64::from(trials),
        })
    }

    /// Return T(`count`): equation (6).
    #[must_use]
    pub fn transform(&self, count: f64) -> f64 {
        transform(count, self.trials)
    }

    /// Return E\[T(L)\] for L ~ Binomial(K, `probability`). A `probability` outside [0, 1] is clipped.
    #[must_use]
    pub fn expectation(&self, probability: f64) -> f64 {
        // The sum starts at the most likely count, whose weight is 1. The weights decrease on both
        // sides of this count, so nothing overflows for any K.
        let probability = probability.clamp(0.0, 1.0);
        let mode = ((self.trials + 1.0) * probability).floor().min(self.trials);
        let odds = probability / (1.0 - probability);
        let (mut total, mut sum) = (1.0, self.transform(mode));
        let mut add = |weight: f64, count: f64| {
            total += weight;
            sum += weight * self.transform(count);
        };
        let (mut weight, mut count) = (1.0, mode);
        while count < self.trials && weight > 1e-18 {
            weight *= (self.trials - count) / (count + 1.0) * odds;
            count += 1.0;
            add(weight, count);
        }
        (weight, count) = (1.0, mode);
        while count > 0.0 && weight > 1e-18 {
            weight *= count / (self.trials - count + 1.0) / odds;
            count -= 1.0;
            add(weight, count);
        }
        sum / total
    }
}

/// The exact unbiased inverse, which maps E\[T(L)\] with L ~ Binomial(K, p) to K p.
///
/// For a large K, a table has too few nodes for rare ones or zeros. Their number then is nearly a
/// Poisson count. The exact inverse exceeds the algebraic one by a bias that depends on the count
/// alone, up to the factor 1 − 2p. The table of a smaller K contains the bias of small counts, and
/// that of larger ones has a closed form (Makitalo and Foi, "Optimal inversion of the Anscombe
/// transformation in low-count Poisson image denoising", 2011, equation (10)).
#[derive(Clone, Debug)]
pub struct ExactInverse {
    trials: f64,
    /// The number of readings of the table: K, or [`Self::MAX_TABULATED`] if K is larger.
    tabulated: f64,
    expectations: Vec<f64>,
    counts: Vec<f64>,
}

impl ExactInverse {
    /// The number of intervals of the table. Its nodes p = sin²(angle) have equidistant angles, so
    /// they are dense where T is steep. The error of linear interpolation is below 10⁻⁶ K.
    const INTERVALS: usize = 2048;

    /// The maximum K of a table. The error of small counts is then below 0.003.
    const MAX_TABULATED: u32 = 1 << 14;

    /// The counts between which the closed form of the bias replaces the table gradually.
    const REPLACED: (f64, f64) = (128.0, 256.0);

    /// Return the tabulated inverse for K = `trials` readings per pixel.
    ///
    /// # Errors
    /// [`Error::Range`] for K = 0.
    pub fn new(trials: u32) -> Result<Self> {
        let anscombe = Anscombe::new(trials.min(Self::MAX_TABULATED))?;
        let probabilities: Vec<f64> = (0..=Self::INTERVALS)
            .map(|node| {
                let angle = std::f64::consts::FRAC_PI_2 * node as f64 / Self::INTERVALS as f64;
                angle.sin().powi(2)
            })
            .collect();
        let expectations = probabilities
            .par_iter()
            .enumerate()
            .map(|(node, &p)| match node {
                _ if interrupt::is_requested() => 0.0,
                0 => anscombe.transform(0.0),
                Self::INTERVALS => anscombe.transform(anscombe.trials),
                _ => anscombe.expectation(p),
            })
            .collect();
        let counts = probabilities.iter().map(|p| p * anscombe.trials).collect();
        Ok(Self {
            trials: f64::from(trials),
            tabulated: anscombe.trials,
            expectations,
            counts,
        })
    }

    /// Return K p for `z` = E\[T(L)\]. A `z` below the range of E\[T(L)\] maps to 0, and a `z`
    /// above it to K.
    #[must_use]
    pub fn inverse(&self, z: f64) -> f64 {
        if self.trials <= self.tabulated {
            return self.look_up(z);
        }
        let largest = std::f64::consts::FRAC_PI_2 * (self.trials + 0.5).sqrt();
        let count = if 2.0 * z <= largest {
            self.rare_count(z)
        } else {
            self.trials - self.rare_count(largest - z)
        };
        count.clamp(0.0, self.trials)
    }

    /// Return K p for a K above that of the table and a p of at most 1/2.
    fn rare_count(&self, z: f64) -> f64 {
        let sine = (z / (self.trials + 0.5).sqrt()).max(0.0).sin();
        let algebraic = (self.trials + 0.75) * sine * sine - 0.375;
        if algebraic <= 0.0 {
            return 0.0;
        }
        // In terms of D = 2 √(count + 3/8), it is 1/4 + √(3/2)/(4 D) − 11/(8 D²).
        let inverse_d = 0.5 / (algebraic + 0.375).sqrt();
        let mut bias = 0.25 + inverse_d * (0.25 * 1.5f64.sqrt() - 1.375 * inverse_d);
        let (first, last) = Self::REPLACED;
        if algebraic < last {
            let tabulated = self.look_up(transform(algebraic, self.tabulated));
            let of_table = (tabulated - algebraic) / (1.0 - 2.0 * algebraic / self.tabulated);
            let share = ((algebraic - first) / (last - first)).max(0.0);
            bias = of_table + share * (bias - of_table);
        }
        algebraic + bias * (1.0 - 2.0 * algebraic / self.trials)
    }

    /// Return the value of the table for `z`.
    fn look_up(&self, z: f64) -> f64 {
        let above = self.expectations.partition_point(|&value| value <= z);
        if above == 0 {
            0.0
        } else if above > Self::INTERVALS {
            self.tabulated
        } else {
            let (left, right) = (self.expectations[above - 1], self.expectations[above]);
            let fraction = (z - left) / (right - left);
            self.counts[above - 1] + fraction * (self.counts[above] - self.counts[above - 1])
        }
    }
}

/// Apply `function` to each value in parallel, and write the results into `out`.
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match.
pub fn map(
    values: ArrayView1<'_, f32>,
    out: ArrayViewMut1<'_, f32>,
    function: impl Fn(f64) -> f64 + Sync,
) -> Result<()> {
    map_indexed(values, out, |_, value| function(value))
}

/// Apply `function` to each value and its number of trials in parallel, and write the results into
/// `out`.
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for trials that are
/// infinite, NaN, or negative.
pub fn map_with_trials(
    values: ArrayView1<'_, f32>,
    trials: Values<'_, f64>,
    out: ArrayViewMut1<'_, f32>,
    function: impl Fn(f64, f64) -> f64 + Sync,
) -> Result<()> {
    trials.check("trials", values.len())?;
    map_indexed(values, out, |index, value| {
        function(value, trials.get(index))
    })
}

/// Apply `function` to the index of each value and the value in parallel.
fn map_indexed(
    values: ArrayView1<'_, f32>,
    mut out: ArrayViewMut1<'_, f32>,
    function: impl Fn(usize, f64) -> f64 + Sync,
) -> Result<()> {
    if values.len() != out.len() {
        return Err(Error::shape("out", values.len(), out.len()));
    }
    let values = values.axis_chunks_iter(Axis(0), VALUES_PER_CHUNK);
    out.axis_chunks_iter_mut(Axis(0), VALUES_PER_CHUNK)
        .into_par_iter()
        .zip(values)
        .enumerate()
        .for_each(|(chunk, (out, values))| {
            if interrupt::is_requested() {
                return;
            }
            let first = chunk * VALUES_PER_CHUNK;
            Zip::indexed(out)
                .and(values)
                .for_each(|index, out, &value| {
                    *out = function(first + index, f64::from(value)) as f32;
                });
        });
    Ok(())
}
