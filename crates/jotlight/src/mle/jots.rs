//! Maximum-likelihood estimates for pixels whose jots differ in their responses.

use num_integer::div_rem;
use rayon::prelude::*;

use super::{JotResponse, JotResponses, PixelResponse};
use crate::error::{Error, Result, check_shape};
use crate::interrupt;
use crate::likelihood::check_counts;
use crate::values::Values;

/// The number of ones of each jot over all frames, of one or more images. Maps hold
/// `(H·K̂) × (W·K̂)` values in row-major order, which belong to each image.
#[derive(Clone, Copy, Debug)]
pub struct JotCounts<'a> {
    /// The number of ones of each jot, `(N, H·K̂, W·K̂)`.
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
            let middle = f64::midpoint(low, high);
            if middle <= low || middle >= high {
                break; // no float lies between them, as between 0 and the smallest one
            }
            if self.score(jots, middle) > 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        f64::midpoint(low, high)
    }
}

/// Write the maximum-likelihood estimate of each pixel into `out` `(N, H, W)`, where jots may differ
/// in their responses. `size` are the height H and the width W of an image in pixels.
///
/// This problem has no closed-form solution. The estimate maximizes the concave function of equation
/// (4), `Σ L_j log P(q, x_j) + (T − L_j) log(1 − P(q, x_j))`, over c in [0, S]. The sum is over the
/// jots j of the pixel that are not dead, and `x_j = η_j α c / K + d_j` is the rate of jot j. A pixel
/// whose jots are all dead becomes NaN.
///
/// # Errors
/// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a count outside 0
/// to the number of frames, an oversampling of 0, a size that does not divide `out` into images, and
/// parameters of the response that are not finite, or negative.
pub fn from_jots(
    response: &PixelResponse,
    counts: &JotCounts<'_>,
    size: (usize, usize),
    out: &mut [f32],
) -> Result<()> {
    response.check()?;
    let oversampling = counts.oversampling;
    if oversampling == 0 {
        return Err(Error::range("oversampling", "at least 1", oversampling));
    }
    let jots = oversampling.checked_mul(oversampling);
    let jots = jots.and_then(|jots| jots.checked_mul(out.len()));
    if jots != Some(counts.ones.len()) {
        let expected = format_args!("{} x {oversampling} x {oversampling}", out.len());
        return Err(Error::shape("ones", expected, counts.ones.len()));
    }
    if out.is_empty() {
        return Ok(());
    }
    let pixels = size.0.checked_mul(size.1);
    let pixels = pixels.filter(|&pixels| pixels > 0 && out.len().is_multiple_of(pixels));
    let Some(pixels) = pixels else {
        let expected = format!("images with {} pixels together", out.len());
        return Err(Error::range("size", expected, format!("{size:?}")));
    };
    let jots = pixels * oversampling * oversampling;
    check_counts(counts.ones, Values::Same(f64::from(counts.frames)))?;
    counts.responses.check(jots)?;
    if let Some(dead) = counts.dead {
        check_shape("mask", jots, dead.len())?;
    }
    let layout = Layout {
        width: size.1,
        jots,
    };
    out.par_iter_mut()
        .enumerate()
        .for_each_init(Vec::new, |jots, (index, out)| {
            if interrupt::is_requested() {
                return;
            }
            collect_valid_jots(counts, layout, index, jots);
            *out = if jots.is_empty() {
                f32::NAN
            } else {
                response.maximize_likelihood(jots) as f32
            };
        });
    Ok(())
}

/// The number of pixels per row, and the number of jots per image.
#[derive(Clone, Copy)]
struct Layout {
    width: usize,
    jots: usize,
}

/// Replace `jots` with the valid jots of a pixel of all images: those that are not dead.
fn collect_valid_jots(counts: &JotCounts<'_>, layout: Layout, pixel: usize, jots: &mut Vec<Jot>) {
    let (oversampling, width) = (counts.oversampling, layout.width);
    let (row, column) = div_rem(pixel, width);
    jots.clear();
    for jot_row in row * oversampling..(row + 1) * oversampling {
        let start = jot_row * width * oversampling + column * oversampling;
        for index in start..start + oversampling {
            // The maps belong to each image.
            let place = index % layout.jots;
            if counts.dead.is_none_or(|dead| !dead[place]) {
                let ones = f64::from(counts.ones[index]);
                jots.push(Jot {
                    ones,
                    zeros: f64::from(counts.frames) - ones,
                    response: counts.responses.get(place),
                });
            }
        }
    }
}
