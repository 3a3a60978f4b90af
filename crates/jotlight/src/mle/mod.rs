//! Maximum-likelihood estimates for the box kernel (paper, equation (5)).
//!
//! `Differs from the paper:` the threshold q may exceed 1, jots have a quantum efficiency and dark
//! counts, and dead jots are left out.

mod jots;
mod table;

use rayon::prelude::*;

use crate::cpu::levels;
use crate::elementary::{ELEMENTS_PER_GROUP, minus_ln_1m};
use crate::error::{Error, Result, check_shape};
use crate::images::for_each_image;
use crate::likelihood::{Rates, Threshold, check_counts};
use crate::values::{Values, check_not_negative, check_positive};
use crate::{elements, interrupt};

use table::look_up_all;

pub use jots::{JotCounts, from_jots};
pub use table::look_up_counts;

/// The number of pixels that a thread computes together.
const PIXELS_PER_CHUNK: usize = 1 << 10;

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

    fn check(&self, length: usize) -> Result<()> {
        self.efficiency.check("efficiency", length)?;
        self.dark_counts.check("dark counts", length)
    }
}

impl JotResponse {
    pub(crate) fn check(&self) -> Result<()> {
        check_positive("efficiency", self.efficiency)?;
        check_not_negative("dark counts", &[self.dark_counts])
    }
}

impl PixelResponse {
    /// Return ĉ = (K/α)(P⁻¹(q, p) − d)/η, clipped to [0, S]: equation (5) for any q, η, and d. Here
    /// p is the detection probability.
    #[must_use]
    pub fn intensity(&self, probability: f64, jot: JotResponse) -> f64 {
        let rate = self.threshold.inverse_detection_probability(probability);
        self.intensity_from_rate(rate, jot)
    }

    #[inline(always)]
    fn intensity_from_rate(&self, rate: f64, jot: JotResponse) -> f64 {
        let intensity = (rate - jot.dark_counts) / (jot.efficiency * self.light_per_intensity);
        intensity.max(0.0).min(self.max_intensity)
    }

    pub(crate) fn check(&self) -> Result<()> {
        check_positive("light at intensity 1", self.light_per_intensity)?;
        check_not_negative("maximum intensity", &[self.max_intensity])
    }

    /// Return the intensity of a pixel with L = `ones` among `trials` readings. It is NaN if there
    /// are no readings.
    fn intensity_from_count(&self, ones: i32, trials: f64, jot: JotResponse) -> f32 {
        if trials == 0.0 {
            f32::NAN
        } else {
            self.intensity(f64::from(ones) / trials, jot) as f32
        }
    }
}

/// Write the maximum-likelihood estimate of each pixel into `out`: equation (5).
///
/// A pixel has `counts` ones among `trials` readings. A pixel without readings becomes NaN.
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a count outside
/// 0 to `trials`, and for parameters of the response that are infinite, NaN, or negative. Values
/// that were written to `out` before have no meaning.
pub fn from_counts(
    response: &PixelResponse,
    counts: &[i32],
    trials: Values<'_, f64>,
    jots: &JotResponses<'_>,
    out: &mut [f32],
) -> Result<()> {
    response.check()?;
    check_lengths(counts, trials, jots, out)?;
    if let (Values::Same(trials), Values::Same(efficiency), Values::Same(dark_counts)) =
        (trials, jots.efficiency, jots.dark_counts)
        && trials < counts.len() as f64
    {
        let jot = JotResponse {
            efficiency,
            dark_counts,
        };
        // A table saves time, because there are fewer possible counts than pixels.
        let mut table = vec![0.0; trials as usize + 1];
        elements::write(&mut table, PIXELS_PER_CHUNK, |ones| {
            response.intensity_from_count(ones as i32, trials, jot)
        });
        let largest = look_up_all(&table, counts, out);
        if f64::from(largest) <= trials {
            return Ok(());
        }
        return check_counts(counts, Values::Same(trials));
    }
    check_counts(counts, trials)?;
    elements::write(out, PIXELS_PER_CHUNK, |index| {
        response.intensity_from_count(counts[index], trials.get(index), jots.get(index))
    });
    Ok(())
}

/// Write the intensity for each detection probability into `out`. This is the last step of the
/// non-iterative method (section 2.2.2).
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for parameters of the
/// response that are infinite, NaN, or negative, and for an efficiency of 0.
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
    jot.check()?;
    if response.threshold.photons() > 1 {
        let rates = Rates::of(&response.threshold);
        elements::write(out, PIXELS_PER_CHUNK, |index| {
            let rate = rates.rate(f64::from(probability[index]));
            response.intensity_from_rate(rate, jot) as f32
        });
        return Ok(());
    }
    let chunks = out.par_chunks_mut(PIXELS_PER_CHUNK);
    let chunks = chunks.zip(probability.par_chunks(PIXELS_PER_CHUNK));
    chunks.for_each(|(out, probability)| {
        if !interrupt::is_requested() {
            one_photon_intensities(response, jot, probability, out);
        }
    });
    Ok(())
}

levels! {
    /// Write the intensity for each detection probability into `out`, for the threshold 1.
    fn one_photon_intensities(
        response: &PixelResponse, jot: JotResponse, probability: &[f32], out: &mut [f32],
    ) = one_photon_intensities_inlined;
}

#[inline(always)]
fn one_photon_intensities_inlined(
    response: &PixelResponse,
    jot: JotResponse,
    probability: &[f32],
    out: &mut [f32],
) {
    let groups = out.chunks_mut(ELEMENTS_PER_GROUP);
    for (out, part) in groups.zip(probability.chunks(ELEMENTS_PER_GROUP)) {
        let mut values = [0.0; ELEMENTS_PER_GROUP];
        values[..part.len()].copy_from_slice(part);
        let mut rates = [0.0; ELEMENTS_PER_GROUP];
        for (rate, value) in rates.iter_mut().zip(values) {
            *rate = f64::from(value);
        }
        // P⁻¹(1, p) = −log(1 − p).
        rates = minus_ln_1m(&rates);
        for (value, rate) in values.iter_mut().zip(rates) {
            *value = response.intensity_from_rate(rate, jot) as f32;
        }
        out.copy_from_slice(&values[..part.len()]);
    }
}

/// Write the expected count of an equivalent pixel for each pixel of some images into `out`. The
/// images have the same number of pixels, and a number of `reference_trials` each. The expected
/// counts are real numbers from 0 to this number.
///
/// The equivalent pixel has the maximum-likelihood intensity of the actual pixel, but the reference
/// number of readings, and jots with the response `reference`. Methods that combine pixels can
/// therefore treat all pixels alike. A pixel without readings becomes NaN.
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a count outside
/// 0 to `trials`, and for other parameters that are infinite, NaN, or negative.
pub fn equivalent_counts(
    response: &PixelResponse,
    counts: &[i32],
    trials: Values<'_, f64>,
    jots: &JotResponses<'_>,
    reference_trials: &[f64],
    reference: JotResponse,
    out: &mut [f32],
) -> Result<()> {
    response.check()?;
    reference.check()?;
    check_not_negative("trials of equivalent pixels", reference_trials)?;
    check_lengths(counts, trials, jots, out)?;
    check_counts(counts, trials)?;
    let images = reference_trials.len();
    let pixels = counts.len().checked_div(images).unwrap_or_default();
    check_shape("pixels of the images", images * pixels, counts.len())?;
    let threshold = response.threshold;
    let expected_count = |index: usize, reference_trials: f64| {
        let (trials, jot) = (trials.get(index), jots.get(index));
        let fraction = f64::from(counts[index]) / trials;
        if trials == 0.0 {
            f32::NAN
        } else if jot == reference {
            (reference_trials * fraction) as f32
        } else {
            let rate = threshold.inverse_detection_probability(fraction);
            // Without efficiency, dark counts alone are no light, as for the intensity above.
            let light = ((rate - jot.dark_counts) / jot.efficiency).max(0.0);
            let reference_rate = reference.efficiency * light + reference.dark_counts;
            (reference_trials * threshold.detection_probability(reference_rate)) as f32
        }
    };
    // Images without pixels have no chunks.
    let images = out.chunks_mut(pixels.max(1)).zip(reference_trials);
    for_each_image(images.enumerate(), |(image, (out, &reference_trials))| {
        elements::write(out, PIXELS_PER_CHUNK, |pixel| {
            expected_count(image * pixels + pixel, reference_trials)
        });
        Ok(())
    })
}

fn check_lengths(
    counts: &[i32],
    trials: Values<'_, f64>,
    jots: &JotResponses<'_>,
    out: &[f32],
) -> Result<()> {
    trials.check_length("trials", counts.len())?;
    jots.check(counts.len())?;
    if out.len() != counts.len() {
        return Err(Error::shape("out", counts.len(), out.len()));
    }
    Ok(())
}
