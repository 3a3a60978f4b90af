//! Maximum-likelihood estimates for the box kernel (paper, equation (5)).
//!
//! `Differs from the paper:` the threshold q may exceed 1, jots have a quantum efficiency and dark
//! counts, and dead jots are left out.

use num_integer::div_rem;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::interrupt;
use crate::likelihood::{Threshold, check_counts};
use crate::values::Values;

/// The number of pixels that a thread computes together.
const PIXELS_PER_CHUNK: usize = 1 << 10;

/// The number of pixels after which a thread asks whether the call is interrupted.
const PIXELS_PER_QUESTION: usize = 1 << 6;

/// The relation between the intensity c of a pixel and the rate η s + d of its jots, where
/// s = α c / K.
#[derive(Clone, Copy, Debug)]
pub struct PixelResponse {
    /// The threshold q.
    pub threshold: Threshold,
    /// α / K, the expected photons per jot and frame at intensity 1.
    pub light_per_intensity: f64,
    /// S, the upper bound of c.
    pub max_intensity: f64,
}

/// The response of a jot to light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JotResponse {
    /// The quantum efficiency η.
    pub efficiency: f64,
    /// The dark counts d: the expected detections per frame without light.
    pub dark_counts: f64,
}

/// The responses to light, either one per jot or one per pixel.
#[derive(Clone, Copy, Debug)]
pub struct JotResponses<'a> {
    /// The quantum efficiency η.
    pub efficiency: Values<'a, f64>,
    /// The dark counts d per frame.
    pub dark_counts: Values<'a, f64>,
}

impl JotResponses<'_> {
    fn get(&self, index: usize) -> JotResponse {
        JotResponse {
            efficiency: self.efficiency.get(index),
            dark_counts: self.dark_counts.get(index),
        }
    }

    fn check_length(&self, length: usize) -> Result<()> {
        self.efficiency.check_length("efficiency", length)?;
        self.dark_counts.check_length("dark counts", length)
    }
}

/// The number of ones of each jot over all frames. Arrays hold `(H·K̂) × (W·K̂)` values in
/// row-major order.
#[derive(Clone, Copy, Debug)]
pub struct JotCounts<'a> {
    /// The number of ones of each jot.
    pub ones: &'a [i32],
    /// The response of each jot.
    pub responses: JotResponses<'a>,
    /// Whether each jot is dead.
    pub dead: Option<&'a [bool]>,
    /// The number of frames T.
    pub frames: i32,
    /// The oversampling K̂.
    pub oversampling: usize,
}

/// The counts of one jot and its response.
struct Jot {
    ones: f64,
    zeros: f64,
    response: JotResponse,
}

impl PixelResponse {
    /// Return ĉ = (K/α)(P⁻¹(q, p) − d)/η, clipped to [0, S]: equation (5) for any q, η, and d. Here
    /// p is the detection probability.
    #[must_use]
    pub fn intensity(&self, probability: f64, jot: JotResponse) -> f64 {
        let rate = self.threshold.inverse_detection_probability(probability);
        let intensity = (rate - jot.dark_counts) / (jot.efficiency * self.light_per_intensity);
        intensity.max(0.0).min(self.max_intensity)
    }

    /// Check that [0, S] is an interval.
    fn check(&self) -> Result<()> {
        if self.max_intensity >= 0.0 {
            return Ok(());
        }
        let received = self.max_intensity;
        Err(Error::range("maximum intensity", "0 or more", received))
    }

    /// Return the intensity of a pixel with L = `ones` among `trials` readings. It is NaN if there
    /// are no readings.
    fn intensity_from_count(&self, ones: i32, trials: i32, jot: JotResponse) -> f32 {
        if trials == 0 {
            f32::NAN
        } else {
            self.intensity(f64::from(ones) / f64::from(trials), jot) as f32
        }
    }

    /// Return dℓ/dc of a pixel, without the factor α / K. It decreases with c, because ℓ is
    /// concave.
    fn score(&self, jots: &[Jot], intensity: f64) -> f64 {
        jots.iter()
            .map(|jot| {
                let JotResponse {
                    efficiency,
                    dark_counts,
                } = jot.response;
                let rate = efficiency * self.light_per_intensity * intensity + dark_counts;
                let mut score = 0.0;
                if jot.ones > 0.0 {
                    score += jot.ones * self.threshold.detection_score(rate);
                }
                if jot.zeros > 0.0 {
                    score -= jot.zeros * self.threshold.non_detection_score(rate);
                }
                efficiency * score
            })
            .sum()
    }

    /// Return the intensity in [0, S] that maximizes the likelihood of the jots of a pixel.
    fn maximize_likelihood(&self, jots: &[Jot]) -> f64 {
        let (mut low, mut high) = (0.0, self.max_intensity);
        // The score of a one is infinite at rate 0, so a tiny positive intensity replaces 0.
        if self.score(jots, f64::MIN_POSITIVE.sqrt()) <= 0.0 {
            return 0.0;
        }
        if self.score(jots, high) >= 0.0 {
            return high;
        }
        // Newton's method could fail, because the score may be infinite at 0. Bisection needs few
        // steps for a float32 result.
        while high - low > 1e-9 * high && !interrupt::is_requested() {
            let middle = 0.5 * (low + high);
            if self.score(jots, middle) > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }
}

/// Write the maximum-likelihood estimate of each pixel into `out`: equation (5).
///
/// A pixel has `counts` ones among `trials` readings. A pixel without readings becomes NaN.
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a count outside
/// 0 to `trials`.
pub fn from_counts(
    response: &PixelResponse,
    counts: &[i32],
    trials: Values<'_, i32>,
    jots: &JotResponses<'_>,
    out: &mut [f32],
) -> Result<()> {
    response.check()?;
    check_pixels(counts, trials, jots, out)?;
    let intensities = match (trials, jots.efficiency, jots.dark_counts) {
        (Values::Same(trials), Values::Same(efficiency), Values::Same(dark_counts))
            if (trials as usize) < counts.len() =>
        {
            // A table saves time, because there are fewer possible counts than pixels.
            let jot = JotResponse {
                efficiency,
                dark_counts,
            };
            let mut intensities = vec![0.0; trials as usize + 1];
            for_each_pixel(&mut intensities, |ones| {
                response.intensity_from_count(ones as i32, trials, jot)
            });
            Some(intensities)
        }
        _ => None,
    };
    for_each_pixel(out, |index| {
        let ones = counts[index];
        match &intensities {
            Some(intensities) => intensities[ones as usize],
            None => response.intensity_from_count(ones, trials.get(index), jots.get(index)),
        }
    });
    Ok(())
}

/// Write the intensity for each detection probability into `out`. This is the last step of the
/// non-iterative method (section 2.2.2).
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match.
pub fn from_probability(
    response: &PixelResponse,
    probability: &[f32],
    jot: JotResponse,
    out: &mut [f32],
) -> Result<()> {
    if probability.len() != out.len() {
        return Err(Error::shape("out", probability.len(), out.len()));
    }
    response.check()?;
    for_each_pixel(out, |index| {
        response.intensity(f64::from(probability[index]), jot) as f32
    });
    Ok(())
}

/// Write the expected count of an equivalent pixel for each pixel into `out`. The expected counts
/// are real numbers in [0, `reference_trials`].
///
/// The equivalent pixel has the maximum-likelihood intensity of the actual pixel, but
/// `reference_trials` readings, and jots with the response `reference`. Methods that combine pixels
/// can therefore treat all pixels alike. A pixel without readings becomes NaN.
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a count outside
/// 0 to `trials`.
pub fn equivalent_counts(
    response: &PixelResponse,
    counts: &[i32],
    trials: Values<'_, i32>,
    jots: &JotResponses<'_>,
    reference_trials: i32,
    reference: JotResponse,
    out: &mut [f32],
) -> Result<()> {
    check_pixels(counts, trials, jots, out)?;
    let reference_trials = f64::from(reference_trials);
    let threshold = response.threshold;
    for_each_pixel(out, |index| {
        let (trials, jot) = (trials.get(index), jots.get(index));
        let fraction = f64::from(counts[index]) / f64::from(trials);
        if trials == 0 {
            f32::NAN
        } else if jot == reference {
            (reference_trials * fraction) as f32
        } else {
            let rate = threshold.inverse_detection_probability(fraction);
            let light = (rate - jot.dark_counts).max(0.0) / jot.efficiency;
            let reference_rate = reference.efficiency * light + reference.dark_counts;
            (reference_trials * threshold.detection_probability(reference_rate)) as f32
        }
    });
    Ok(())
}

/// Write the value of each pixel into `out`.
fn for_each_pixel(out: &mut [f32], value: impl Fn(usize) -> f32 + Sync) {
    let chunks = out.par_chunks_mut(PIXELS_PER_CHUNK).enumerate();
    chunks.for_each(|(number, out)| {
        for (index, out) in (number * PIXELS_PER_CHUNK..).zip(out) {
            if index % PIXELS_PER_QUESTION == 0 && interrupt::is_requested() {
                return;
            }
            *out = value(index);
        }
    });
}

/// Write the maximum-likelihood estimate of each pixel into `out`, where jots may differ in their
/// responses. `width` is the number of pixels per row.
///
/// This problem has no closed-form solution. The estimate maximizes the concave function
/// `Σ L_j log P(q, x_j) + (T − L_j) log(1 − P(q, x_j))` over c in [0, S]. The sum is over the jots
/// j of the pixel that are not dead, and `x_j = η_j α c / K + d_j` is the rate of jot j. A pixel
/// whose jots are all dead becomes NaN.
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a count outside 0
/// to the number of frames, or an oversampling of 0.
pub fn from_jots(
    response: &PixelResponse,
    counts: &JotCounts<'_>,
    width: usize,
    out: &mut [f32],
) -> Result<()> {
    response.check()?;
    let oversampling = counts.oversampling;
    if oversampling == 0 {
        return Err(Error::range("oversampling", "at least 1", oversampling));
    }
    let jots = oversampling.checked_mul(oversampling);
    let jots = jots.and_then(|jots| jots.checked_mul(out.len()));
    let jots = jots.filter(|&jots| jots == counts.ones.len());
    let Some(jots) = jots else {
        let expected = format!("{} x {oversampling} x {oversampling}", out.len());
        return Err(Error::shape("ones", expected, counts.ones.len()));
    };
    if out.is_empty() {
        return Ok(());
    }
    if width == 0 || !out.len().is_multiple_of(width) {
        let expected = format!("a divisor of the {} pixels", out.len());
        return Err(Error::range("width", expected, width));
    }
    check_counts(counts.ones, Values::Same(counts.frames))?;
    counts.responses.check_length(jots)?;
    if let Some(dead) = counts.dead
        && dead.len() != jots
    {
        return Err(Error::shape("mask", jots, dead.len()));
    }
    out.par_iter_mut()
        .enumerate()
        .for_each_init(Vec::new, |jots, (index, out)| {
            if interrupt::is_requested() {
                return;
            }
            collect_valid_jots(counts, div_rem(index, width), width, jots);
            *out = if jots.is_empty() {
                f32::NAN
            } else {
                response.maximize_likelihood(jots) as f32
            };
        });
    Ok(())
}

/// Replace `jots` with the valid jots of the pixel at `(row, column)`: those that are not dead.
fn collect_valid_jots(
    counts: &JotCounts<'_>,
    (row, column): (usize, usize),
    width: usize,
    jots: &mut Vec<Jot>,
) {
    let oversampling = counts.oversampling;
    jots.clear();
    for jot_row in row * oversampling..(row + 1) * oversampling {
        let start = jot_row * width * oversampling + column * oversampling;
        for index in start..start + oversampling {
            if counts.dead.is_none_or(|dead| !dead[index]) {
                let ones = f64::from(counts.ones[index]);
                jots.push(Jot {
                    ones,
                    zeros: f64::from(counts.frames) - ones,
                    response: counts.responses.get(index),
                });
            }
        }
    }
}

fn check_pixels(
    counts: &[i32],
    trials: Values<'_, i32>,
    jots: &JotResponses<'_>,
    out: &[f32],
) -> Result<()> {
    trials.check_length("trials", counts.len())?;
    jots.check_length(counts.len())?;
    if out.len() != counts.len() {
        return Err(Error::shape("out", counts.len(), out.len()));
    }
    check_counts(counts, trials)
}
