//! Readings of several bits, and read noise: probabilities, likelihood, information, and drawing.
//!
//! A jot collects Y ~ Poisson(s) photons. Read noise adds a normal number of standard deviation σ,
//! and the sum is rounded: L = round(Y + σ N). A reading of b bits is L, clipped to 0 … 2^b − 1. A
//! reading of one bit is [L ≥ q]. Without read noise, L = Y, and a reading is min(Y, 2^b − 1).
//!
//! The probability of each reading is log-concave in s: the weights P(L = l | Y = y) are
//! log-concave in y, and the average over a Poisson distribution preserves this. So the likelihood
//! of several readings has one maximum.
//!
//! Functions of the rate s are NaN for NaN. At an infinite rate, they are their limits.

mod distribution;
mod draw;
mod likelihood;
mod noise;
mod poisson;
mod rates;
mod scores;
mod sums;
mod table;
#[cfg(test)]
mod tests;

use crate::error::{Error, Result};
use crate::likelihood::Threshold;
use noise::{Level, Noise};
use poisson::ln_poisson;
use sums::{ln_sum, moments};

pub use draw::draw;
pub use likelihood::{Cells, Sample};
pub use scores::ScoreTable;
pub use table::RateTable;

/// The smallest rate at which derivatives are evaluated.
const MIN_RATE: f64 = 1e-100;

/// The smallest logarithm of a probability whose difference to another one has ten digits.
const MIN_LOGARITHM: f64 = -1e5;

/// How a jot turns photons into a reading.
#[derive(Clone, Debug)]
pub struct Response {
    /// The level of reading 0, q − 1. Smaller levels are the same reading.
    lowest: i64,
    /// The level of the highest reading. Larger levels are the same reading.
    highest: i64,
    noise: Option<Noise>,
    /// The thresholds between the lowest reading and the next, and between the highest and its
    /// predecessor.
    thresholds: [Threshold; 2],
}

impl PartialEq for Response {
    fn eq(&self, other: &Self) -> bool {
        // The thresholds and the tables of the noise follow from these numbers.
        let numbers = |each: &Self| {
            let sigma = each.noise.as_ref().map(Noise::sigma);
            (each.lowest, each.highest, sigma)
        };
        numbers(self) == numbers(other)
    }
}

impl Response {
    /// The maximum standard deviation of read noise.
    pub const MAX_NOISE: f64 = 100.0;

    /// The minimum standard deviation of read noise, unless there is none. Less changes no reading.
    pub const MIN_NOISE: f64 = 1e-3;

    /// The maximum reading, of 16 bits.
    pub const MAX_READING: u32 = 65_535;

    /// Return the response with readings 0 to `max_reading`, of which 1 stands for `threshold`
    /// photons, and read noise of standard deviation `noise`: 0, or [`Self::MIN_NOISE`] or more.
    ///
    /// # Errors
    /// [`Error::Range`] for numbers outside their ranges.
    pub fn new(max_reading: u32, noise: f64, threshold: u32) -> Result<Self> {
        if !(1..=Self::MAX_READING).contains(&max_reading) {
            let expected = format!("1 to {}", Self::MAX_READING);
            return Err(Error::range("max reading", expected, max_reading));
        }
        if noise != 0.0 && !(Self::MIN_NOISE..=Self::MAX_NOISE).contains(&noise) {
            let expected = format!("0, or {} to {}", Self::MIN_NOISE, Self::MAX_NOISE);
            return Err(Error::range("read noise", expected, noise));
        }
        let highest = i64::from(threshold) - 1 + i64::from(max_reading);
        let top = u32::try_from(highest).unwrap_or(0);
        Ok(Self {
            lowest: i64::from(threshold) - 1,
            highest,
            noise: (noise > 0.0).then(|| Noise::new(noise)),
            thresholds: [Threshold::new(threshold)?, Threshold::new(top)?],
        })
    }

    /// Return the highest reading.
    #[must_use]
    pub fn max_reading(&self) -> u32 {
        (self.highest - self.lowest) as u32
    }

    /// Return log P(R = `reading`) at a rate s.
    #[must_use]
    pub fn ln_probability(&self, reading: u32, s: f64) -> f64 {
        let level = self.level(reading);
        if s.is_nan() {
            return s;
        }
        if s == f64::INFINITY {
            let is_highest = matches!(level, Level::AtLeast(_));
            return if is_highest { 0.0 } else { f64::NEG_INFINITY };
        }
        match (&self.noise, level) {
            _ if s <= 0.0 && self.noise.is_none() => match level {
                Level::AtMost(_) => 0.0,
                _ => f64::NEG_INFINITY,
            },
            (Some(noise), _) if s <= 0.0 => noise.ln_weight(level, 0),
            (Some(noise), _) => ln_with_noise(noise, level, s),
            (None, Level::Exactly(l)) => ln_poisson(l as f64, s),
            (None, Level::AtMost(_)) => self.thresholds[0].log_non_detection_probability(s),
            (None, Level::AtLeast(_)) => self.thresholds[1].log_detection_probability(s),
        }
    }

    /// Return d log P(R = `reading`)/ds and −d² log P(R = `reading`)/ds².
    #[must_use]
    pub fn score_and_curvature(&self, reading: u32, s: f64) -> (f64, f64) {
        let level = self.level(reading);
        if s.is_nan() {
            return (s, s);
        }
        if s == f64::INFINITY {
            let is_highest = matches!(level, Level::AtLeast(_));
            return (if is_highest { 0.0 } else { -1.0 }, 0.0);
        }
        let s = s.max(MIN_RATE);
        let Some(noise) = &self.noise else {
            return match level {
                Level::Exactly(l) => (l as f64 / s - 1.0, l as f64 / s / s),
                Level::AtMost(_) => {
                    let (score, curvature) =
                        self.thresholds[0].non_detection_score_and_curvature(s);
                    (-score, curvature)
                }
                Level::AtLeast(_) => self.thresholds[1].detection_score_and_curvature(s),
            };
        };
        let from_moments = || {
            let (first, second) = moments(noise, level, s);
            (first - 1.0, (first * first - second).max(0.0))
        };
        let (l, sign) = match level {
            Level::Exactly(_) => return from_moments(),
            // One more photon moves some of the probability of one level out of `AtMost(l)`, and
            // some of that of l − 1 into `AtLeast(l)`.
            Level::AtMost(l) => (l, -1.0),
            Level::AtLeast(l) => (l - 1, 1.0),
        };
        let whole = ln_with_noise(noise, level, s);
        if whole < MIN_LOGARITHM {
            return from_moments();
        }
        let [edge, next] = [l, l - 1].map(|l| (ln_sum(noise, Level::Exactly(l), s) - whole).exp());
        let score = sign * edge;
        (score, (score * score - sign * (next - edge)).max(0.0))
    }

    /// Return the Fisher information of a reading about the rate s.
    #[must_use]
    pub fn information(&self, s: f64) -> f64 {
        if s.is_nan() {
            return s;
        }
        if s == f64::INFINITY {
            return 0.0;
        }
        let s = s.max(MIN_RATE);
        let sigma = self.noise.as_ref().map_or(0.0, Noise::sigma);
        let reach = 12.0 * (s + sigma * sigma).sqrt() + 12.0 * sigma + 30.0;
        let first = ((s - reach).max(-1e15) as i64).max(self.lowest - 1);
        let last = ((s + reach).min(1e15) as i64).min(self.highest);
        if first > self.highest - 1 {
            return 0.0;
        }
        // The derivative of P(L = l) is P(L = l − 1) − P(L = l).
        let mut before = self.level_probability(first, s);
        let mut information = 0.0;
        for l in first + 1..=last {
            if l == self.highest {
                break;
            }
            let own = self.level_probability(l, s);
            if l == self.lowest {
                let whole = self.ln_probability(0, s).exp();
                information += ratio_of_squares(own, whole);
            } else if l > self.lowest {
                information += ratio_of_squares(before - own, own);
            }
            before = own;
        }
        if last == self.highest {
            let whole = self.ln_probability(self.max_reading(), s).exp();
            information += ratio_of_squares(before, whole);
        }
        information
    }

    /// Return a table of the logarithm of [`Self::information`].
    #[must_use]
    pub fn information_table(&self) -> RateTable<impl Fn(f64) -> [f64; 1], 1> {
        RateTable::new(|s| [self.information(s).ln()], self.saturating_rate())
    }

    /// Return a table of [`Self::moments`].
    #[must_use]
    pub fn moments_table(&self) -> RateTable<impl Fn(f64) -> [f64; 3], 3> {
        RateTable::new(|s| self.moments(s).into(), self.saturating_rate())
    }

    /// Return a rate above which nearly all readings are the highest one.
    fn saturating_rate(&self) -> f64 {
        let (top, sigma) = (
            self.highest as f64,
            self.noise.as_ref().map_or(0.0, Noise::sigma),
        );
        top + 12.0 * (top.sqrt() + sigma) + 100.0
    }

    /// Return the mean and the variance of a reading at the rate s, and the derivative of the mean.
    ///
    /// One more photon raises the reading by 1 if the level is that of any reading but the highest.
    #[must_use]
    pub fn moments(&self, s: f64) -> (f64, f64, f64) {
        let top = self.max_reading();
        if s.is_nan() {
            return (s, s, s);
        }
        if s == f64::INFINITY {
            return (f64::from(top), 0.0, 0.0);
        }
        let s = s.max(MIN_RATE);
        let sigma = self.noise.as_ref().map_or(0.0, Noise::sigma);
        let reach = 12.0 * (s + sigma * sigma).sqrt() + 12.0 * sigma + 30.0;
        let near = s - self.lowest as f64;
        // Two readings or more, so that the probability of one that is not sure is among them.
        let first = (near - reach).clamp(0.0, f64::from(top - 1)) as u32;
        let last = (near + reach).clamp(1.0, f64::from(top)) as u32;
        let mut probabilities = vec![0.0; (last - first + 1) as usize];
        self.write_probabilities(first, s, &mut probabilities);
        let mut slope = self.level_probability(self.lowest, s);
        let mut mean = 0.0;
        for (reading, probability) in (first..).zip(&probabilities) {
            mean += f64::from(reading - first) * probability;
            if 0 < reading && reading < top {
                slope += probability;
            }
        }
        let mut variance = 0.0;
        for (value, probability) in (0..).zip(&probabilities) {
            variance += (f64::from(value) - mean).powi(2) * probability;
        }
        (mean + f64::from(first), variance, slope.min(1.0))
    }

    fn level(&self, reading: u32) -> Level {
        let level = self.lowest + i64::from(reading);
        if level >= self.highest {
            Level::AtLeast(self.highest)
        } else if reading == 0 {
            Level::AtMost(level)
        } else {
            Level::Exactly(level)
        }
    }

    /// Return P(L = l), also for levels that share a reading with others.
    fn level_probability(&self, l: i64, s: f64) -> f64 {
        match &self.noise {
            Some(noise) => ln_sum(noise, Level::Exactly(l), s).exp(),
            None if l < 0 => 0.0,
            None => ln_poisson(l as f64, s).exp(),
        }
    }
}

/// Return a²/b, and 0 where b is 0.
fn ratio_of_squares(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b * a } else { 0.0 }
}

/// Return log P(level) with read noise.
fn ln_with_noise(noise: &Noise, level: Level, s: f64) -> f64 {
    if let Level::AtLeast(l) = level
        && s - 40.0 * s.sqrt() - 40.0 * noise.sigma() > l as f64
    {
        return 0.0;
    }
    ln_sum(noise, level, s)
}
