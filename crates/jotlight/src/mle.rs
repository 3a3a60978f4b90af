//! Maximum likelihood for the box kernel (paper, equation (5)), for any threshold, with dark counts and dead jots.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::likelihood::{Threshold, Values, check_counts};

/// How the intensity c of a pixel becomes the rate of its jots, η s + d with s = α c / K, and back.
#[derive(Clone, Copy, Debug)]
pub struct PixelResponse {
    /// The threshold q.
    pub threshold: Threshold,
    /// α / K: photons per jot and frame for unit intensity.
    pub light: f64,
    /// S, the upper bound of c.
    pub max_intensity: f64,
}

/// What a jot makes of the light on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jot {
    /// η, the share of it that is detected.
    pub efficiency: f64,
    /// d, what is detected without light, per frame.
    pub dark: f64,
}

/// What the jots of each pixel have in common.
#[derive(Clone, Copy, Debug)]
pub struct Jots<'a> {
    /// η.
    pub efficiency: Values<'a, f64>,
    /// d.
    pub dark: Values<'a, f64>,
}

impl Jots<'_> {
    fn at(&self, index: usize) -> Jot {
        Jot {
            efficiency: self.efficiency.at(index),
            dark: self.dark.at(index),
        }
    }

    fn check(&self, length: usize) -> Result<()> {
        self.efficiency.check("efficiency", length)?;
        self.dark.check("dark counts", length)
    }
}

impl PixelResponse {
    /// ĉ = (K/α)(P⁻¹(q, p) − d)/η clipped to [0, S]: equation (5), for any q and with dark counts d.
    #[must_use]
    pub fn intensity(&self, probability: f64, jot: Jot) -> f64 {
        ((self.threshold.rate(probability) - jot.dark) / (jot.efficiency * self.light))
            .clamp(0.0, self.max_intensity)
    }
}

/// The maximum-likelihood picture from counts of ones out of `trials` valid bits a pixel. A pixel without a valid bit becomes NaN, for the
/// caller to fill.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn from_counts(
    response: &PixelResponse,
    counts: &[i32],
    trials: Values<'_, i32>,
    jots: &Jots<'_>,
    out: &mut [f32],
) -> Result<()> {
    check(counts, trials, jots, out)?;
    let one_curve = match (trials, jots.efficiency, jots.dark) {
        (Values::Same(trials), Values::Same(efficiency), Values::Same(dark))
            if (trials as usize) < counts.len() =>
        {
            // Fewer counts are possible than there are pixels: one look-up table.
            Some(
                (0..=trials)
                    .map(|ones| estimate(response, ones, trials, Jot { efficiency, dark }))
                    .collect::<Vec<f32>>(),
            )
        }
        _ => None,
    };
    out.par_iter_mut().enumerate().for_each(|(index, out)| {
        let ones = counts[index];
        *out = match &one_curve {
            Some(curve) => curve[ones as usize],
            None => estimate(response, ones, trials.at(index), jots.at(index)),
        };
    });
    Ok(())
}

fn estimate(response: &PixelResponse, ones: i32, trials: i32, jot: Jot) -> f32 {
    if trials == 0 {
        f32::NAN
    } else {
        response.intensity(f64::from(ones) / f64::from(trials), jot) as f32
    }
}

/// The intensity that makes each pixel's bits fire with a given probability; the last step of the non-iterative method.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn from_probability(
    response: &PixelResponse,
    probability: &[f32],
    jot: Jot,
    out: &mut [f32],
) -> Result<()> {
    if probability.len() != out.len() {
        return Err(Error::shape("out", probability.len(), out.len()));
    }
    out.par_iter_mut()
        .zip(probability)
        .for_each(|(out, &probability)| {
            *out = response.intensity(f64::from(probability), jot) as f32;
        });
    Ok(())
}

/// The counts that pixels with other jots and fewer valid bits would have shown with jots as `reference` and all `bits`
/// valid, as real numbers in [0, `bits`]: what a method that looks at many pixels at once takes in. NaN without a valid bit.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn equivalent_counts(
    response: &PixelResponse,
    counts: &[i32],
    trials: Values<'_, i32>,
    jots: &Jots<'_>,
    bits: i32,
    reference: Jot,
    out: &mut [f32],
) -> Result<()> {
    check(counts, trials, jots, out)?;
    let all = f64::from(bits);
    out.par_iter_mut().enumerate().for_each(|(index, out)| {
        let (trials, jot) = (trials.at(index), jots.at(index));
        let fraction = f64::from(counts[index]) / f64::from(trials);
        *out = if trials == 0 {
            f32::NAN
        } else if jot == reference {
            (all * fraction) as f32
        } else {
            let light = (response.threshold.rate(fraction) - jot.dark).max(0.0) / jot.efficiency;
            let rate = reference.efficiency * light + reference.dark;
            (all * response.threshold.fires(rate)) as f32
        };
    });
    Ok(())
}

fn check(counts: &[i32], trials: Values<'_, i32>, jots: &Jots<'_>, out: &[f32]) -> Result<()> {
    trials.check("trials", counts.len())?;
    jots.check(counts.len())?;
    if out.len() != counts.len() {
        return Err(Error::shape("out", counts.len(), out.len()));
    }
    check_counts(counts, trials)
}

/// Maximum likelihood for pixels whose jots differ, which has no closed form: the scalar concave
/// problem max over c of Σ L_j log P(q, x_j) + (T − L_j) log(1 − P(q, x_j)), x_j = η_j α c / K + d_j, solved to rounding.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn from_jots(
    response: &PixelResponse,
    jots: &JotCounts<'_>,
    width: usize,
    out: &mut [f32],
) -> Result<()> {
    let side = jots.side;
    if jots.ones.len() != out.len() * side * side || !out.len().is_multiple_of(width.max(1)) {
        return Err(Error::shape(
            "ones",
            out.len() * side * side,
            jots.ones.len(),
        ));
    }
    jots.jots.check(jots.ones.len())?;
    if let Some(dead) = jots.dead
        && dead.len() != jots.ones.len()
    {
        return Err(Error::shape("mask", jots.ones.len(), dead.len()));
    }
    out.par_iter_mut().enumerate().for_each_init(
        Vec::new,
        |block: &mut Vec<(f64, f64, Jot)>, (index, out)| {
            let (row, column) = (index / width, index % width);
            block.clear();
            for line in 0..side {
                let start = (row * side + line) * width * side + column * side;
                for jot in start..start + side {
                    if jots.dead.is_none_or(|dead| !dead[jot]) {
                        let ones = f64::from(jots.ones[jot]);
                        block.push((ones, f64::from(jots.frames) - ones, jots.jots.at(jot)));
                    }
                }
            }
            *out = if block.is_empty() {
                f32::NAN
            } else {
                response.most_likely(block) as f32
            };
        },
    );
    Ok(())
}

/// What each jot reported over all frames, `(H·K̂) × (W·K̂)` of them row by row.
#[derive(Clone, Copy, Debug)]
pub struct JotCounts<'a> {
    /// Ones of each jot.
    pub ones: &'a [i32],
    /// What each makes of the light.
    pub jots: Jots<'a>,
    /// True for a dead jot.
    pub dead: Option<&'a [bool]>,
    /// T.
    pub frames: i32,
    /// K̂.
    pub side: usize,
}

impl PixelResponse {
    /// dℓ/dc of a pixel, up to the factor α / K: falls as c grows, since ℓ is concave.
    fn score(&self, block: &[(f64, f64, Jot)], intensity: f64) -> f64 {
        block
            .iter()
            .map(|&(ones, zeros, jot)| {
                let rate = jot.efficiency * self.light * intensity + jot.dark;
                let mut score = 0.0;
                if ones > 0.0 {
                    score += ones * self.threshold.fired_score(rate);
                }
                if zeros > 0.0 {
                    score -= zeros * self.threshold.dark_score(rate);
                }
                jot.efficiency * score
            })
            .sum()
    }

    fn most_likely(&self, block: &[(f64, f64, Jot)]) -> f64 {
        let (mut low, mut high) = (0.0, self.max_intensity);
        // At s = 0 a jot that fired has an infinite score, so the smallest positive intensity stands for 0.
        if self.score(block, f64::MIN_POSITIVE.sqrt()) <= 0.0 {
            return 0.0;
        }
        if self.score(block, high) >= 0.0 {
            return high;
        }
        // Bisection: the score may be infinite at one end, and a float32 picture needs few steps.
        while high - low > 1e-9 * high {
            let middle = 0.5 * (low + high);
            if self.score(block, middle) > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }
}
