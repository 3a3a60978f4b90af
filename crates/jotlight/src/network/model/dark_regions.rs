//! Dark regions: the mean of an estimate is that of the bits.
//!
//! Networks were trained for scenes in which ones are frequent. Where nearly no bit is 1, they return
//! probabilities of about 1e-3, which may be far too large. With a threshold q, the intensity is about
//! p^(1/q) there, so dark regions looked bright. Yet the bits of a neighborhood show its mean well. So
//! the probability p of a one becomes
//!
//! ```text
//! p r^m,    r = f(sum of g m N) / f(sum of g m K p),
//! f(n) = (Γ(n + 3/(2q)) / Γ(n + 1/(2q)))^q,
//! ```
//!
//! where m = 1 / (1 + (p / p0)²) selects dark pixels, and N is the number of ones of K bits. The
//! weights g of a Gaussian window sum to 4 π σ² pixels. f(n) is the number of ones that are expected
//! at the mean intensity x, if n ones were observed, their expected number is proportional to x^q, and
//! the prior is 1/√x. For q = 1, it is n + 1/2. Where the sum of K p is so small that f is f(0),
//! nothing changes.
//!
//! Where p is even smaller, its differences between pixels are those of the filters of the network,
//! and not of the scene. There, it first becomes its own mean in the window.

use std::f64::consts::PI;

use ndarray::{ArcArray, Array2, ArrayView2, Axis, Ix2, Zip};

use super::SensorModel;
use super::local_trials::{LocalTrials, extremes};
use super::pixels::check_ones;
use crate::error::{Error, Result};
use crate::filter;
use crate::likelihood::Threshold;

/// p0: a pixel is dark if its probability of a one is below about this value.
const DARK: f64 = 5e-3;

/// Below about this value, p becomes its mean in the window.
const EMPTY: f64 = 5e-4;

/// The standard deviation of the window in pixels.
const SIGMA: f64 = 8.0;

/// The smallest divisor of a mean.
const MIN_WEIGHT: f32 = 1e-12;

/// The largest exponent. A probability is at most 1, so larger ones would change nothing.
const MAX_EXPONENT: f64 = 80.0;

impl SensorModel {
    /// Return whether an image of intensities has dark pixels whose brightness would be wrong.
    ///
    /// For a threshold of 1, a wrong small p is a wrong small intensity, which matters little.
    #[must_use]
    pub fn may_have_dark_regions(&self, image: ArrayView2<'_, f32>) -> bool {
        let smallest = || f64::from(extremes(image).0);
        self.response.threshold.photons() > 1 && self.detection_probability(smallest()) < DARK
    }
}

/// Return probabilities of a one whose means in dark regions are those of the bits.
///
/// `fractions` are the fractions of ones, finite numbers of at least 0, and `trials` their local
/// trials. Probabilities below 0 count as 0.
///
/// # Errors
/// [`Error::Shape`] if the shapes do not match. [`Error::Range`] for fractions that are not finite or
/// below 0.
///
/// # Examples
/// ```
/// use jotlight::likelihood::Threshold;
/// use jotlight::network::{LocalTrials, match_dark_regions};
/// use ndarray::Array2;
///
/// // A network returns 1e-3 everywhere, but none of 64 × 64 pixels has a one in 64 bits.
/// let (wrong, none) = (Array2::from_elem((64, 64), 1e-3), Array2::zeros((64, 64)));
/// let trials = LocalTrials::Same(64);
/// let found = match_dark_regions(wrong.view(), none.view(), &trials, Threshold::new(1)?)?;
/// assert!(found.iter().all(|&p| p < 2e-5));
/// # Ok::<(), jotlight::error::Error>(())
/// ```
pub fn match_dark_regions(
    probabilities: ArrayView2<'_, f32>,
    fractions: ArrayView2<'_, f32>,
    trials: &LocalTrials,
    threshold: Threshold,
) -> Result<Array2<f32>> {
    let shape = probabilities.dim();
    if fractions.dim() != shape {
        return Err(Error::shape("fractions", shape, fractions.dim()));
    }
    trials.check_shape(shape)?;
    check_ones("fractions", fractions)?;
    if f64::from(extremes(probabilities).0) >= DARK {
        return Ok(probabilities.to_owned());
    }
    let mut p = probabilities.mapv(|p| p.max(0.0));
    let trials = trials.to_array();
    let weigh_empty = |p, _, trials| {
        let bits = below(p, EMPTY) * trials;
        [bits, bits * p]
    };
    let [number, sum] = window_means(&p, fractions, &trials, weigh_empty)?;
    Zip::from(&mut p)
        .and(&number)
        .and(&sum)
        .par_for_each(|p, &number, &sum| {
            *p += below(*p, EMPTY) * (sum / number.max(MIN_WEIGHT) - *p);
        });
    let weigh_dark = |p, fraction, trials| {
        let bits = below(p, DARK) * trials;
        [bits * fraction, bits * p]
    };
    let [ones, expected] = window_means(&p, fractions, &trials, weigh_dark)?;
    let q = f64::from(threshold.photons());
    Zip::from(&mut p)
        .and(&ones)
        .and(&expected)
        .par_for_each(|p, &ones, &expected| *p = matched(*p, ones, expected, q));
    Ok(p)
}

/// Return p r^m from the means of m N and of m K p in the window.
fn matched(p: f32, ones: f32, expected: f32, q: f64) -> f32 {
    // A Gaussian window weighs as many pixels like a uniform one.
    let pixels = (4.0 * PI * SIGMA * SIGMA) as f32;
    let [ones, expected] = [ones, expected].map(|n| log_of_expected(f64::from(pixels * n), q));
    let exponent = f64::from(below(p, DARK)) * (ones - expected);
    let matched = f64::from(p) * exponent.min(MAX_EXPONENT).exp();
    // Smaller numbers of f32 are inaccurate, or 0.
    matched.clamp(f64::from(p.min(f32::MIN_POSITIVE)), 1.0) as f32
}

/// Return log f(n), whose exponential may underflow for a high threshold.
fn log_of_expected(ones: f64, q: f64) -> f64 {
    if q < 1.5 {
        return (ones + 0.5).ln();
    }
    q * (libm::lgamma(ones + 1.5 / q) - libm::lgamma(ones + 0.5 / q))
}

/// Return about 1 where p is below a limit, and about 0 where it is far above.
fn below(p: f32, limit: f64) -> f32 {
    1.0 / (1.0 + (p / limit as f32).powi(2))
}

/// Return the means of two values in the window around each pixel. They depend on p, the fraction of
/// ones, and the trials of a pixel.
fn window_means(
    p: &Array2<f32>,
    fractions: ArrayView2<'_, f32>,
    trials: &ArcArray<f32, Ix2>,
    values: impl Fn(f32, f32, f32) -> [f32; 2] + Sync + Send,
) -> Result<[Array2<f32>; 2]> {
    let mut both = [Array2::zeros(p.dim()), Array2::zeros(p.dim())];
    let [first, second] = &mut both;
    Zip::from(first)
        .and(second)
        .and(p)
        .and(fractions)
        .and_broadcast(trials)
        .par_for_each(|first, second, &p, &fraction, &trials| {
            [*first, *second] = values(p, fraction, trials);
        });
    for image in &mut both {
        let source = image.clone();
        let place = image.view_mut().insert_axis(Axis(0));
        filter::blur(source.view().insert_axis(Axis(0)), SIGMA, place)?;
    }
    Ok(both)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mle::{JotResponse, PixelResponse};

    fn log_gamma_ratio(ones: u32, q: u32) -> f64 {
        log_of_expected(ones.into(), q.into())
    }

    #[test]
    fn the_bits_of_a_dark_region_show_its_mean_intensity() {
        // The integral over all intensities x, with the prior 1/√x, is the oracle.
        let step = 1e-5;
        for (q, ones) in [(2, 0), (2, 7), (3, 1), (8, 0), (8, 3)] {
            let (mut sum, mut weighted) = (0.0, 0.0);
            for index in 1..400_000 {
                let x = step * f64::from(index);
                let exponent = f64::from(q * ones) - 0.5;
                let posterior = x.powf(exponent) * (-x.powi(q as i32)).exp();
                sum += posterior;
                weighted += x * posterior;
            }
            let expected = (weighted / sum).ln() * f64::from(q);
            let found = log_gamma_ratio(ones, q);
            assert!(
                (found - expected).abs() < 0.02,
                "{q} {ones}: {found} {expected}"
            );
        }
    }

    #[test]
    fn bright_probabilities_stay_as_they_are() -> Result<()> {
        let p = Array2::from_shape_fn((9, 7), |(y, x)| 6e-3 + 0.01 * (7 * y + x) as f32);
        let trials = LocalTrials::Same(16);
        let found = match_dark_regions(p.view(), p.view(), &trials, Threshold::new(3)?)?;
        assert_eq!(found, p);
        Ok(())
    }

    #[test]
    fn dark_regions_get_the_mean_of_their_bits() -> Result<()> {
        // 1000 bits of each pixel show 2e-4. A network returned 1e-3.
        let wrong = Array2::from_elem((40, 50), 1e-3);
        let shown = Array2::from_elem((40, 50), 2e-4);
        for trials in [
            LocalTrials::Same(1000),
            LocalTrials::Map(Array2::from_elem((40, 50), 1000.0).into_shared()),
        ] {
            for (q, tolerance) in [(1, 0.1), (5, 0.15)] {
                let threshold = Threshold::new(q)?;
                let found = match_dark_regions(wrong.view(), shown.view(), &trials, threshold)?;
                assert!(found.iter().all(|&p| (p / 2e-4 - 1.0).abs() < tolerance));
            }
        }
        Ok(())
    }

    #[test]
    fn the_largest_threshold_causes_no_overflow() -> Result<()> {
        let p = Array2::from_elem((8, 8), 1e-4);
        let none = Array2::zeros((8, 8));
        let threshold = Threshold::new(Threshold::MAX_PHOTONS)?;
        let found = match_dark_regions(p.view(), none.view(), &LocalTrials::Same(16), threshold)?;
        assert!(found.iter().all(|&p| (0.0..1e-4).contains(&p)));
        Ok(())
    }

    #[test]
    fn fractions_that_are_negative_or_not_finite_are_refused() -> Result<()> {
        let (same, threshold) = (LocalTrials::Same(4), Threshold::new(2)?);
        for p in [1e-3, 0.5] {
            let p = Array2::from_elem((4, 5), p);
            for wrong in [-1e-3, f32::NAN, f32::INFINITY] {
                let mut fractions = Array2::zeros((4, 5));
                fractions[[2, 3]] = wrong;
                let found = match_dark_regions(p.view(), fractions.view(), &same, threshold);
                let expected = "finite numbers of at least 0; replace those below it with 0";
                assert_eq!(found, Err(Error::range("fractions", expected, wrong)));
            }
        }
        Ok(())
    }

    #[test]
    fn other_shapes_are_refused() -> Result<()> {
        let (p, other) = (Array2::<f32>::zeros((4, 5)), Array2::<f32>::zeros((5, 4)));
        let (same, threshold) = (LocalTrials::Same(4), Threshold::new(2)?);
        assert!(match_dark_regions(p.view(), other.view(), &same, threshold).is_err());
        let map = LocalTrials::Map(other.into_shared());
        assert!(match_dark_regions(p.view(), p.view(), &map, threshold).is_err());
        Ok(())
    }

    #[test]
    fn only_thresholds_above_1_have_dark_regions() -> Result<()> {
        let image = Array2::from_elem((4, 4), 0.1);
        for (q, expected) in [(1, false), (3, true)] {
            let sensor = SensorModel {
                trials: 16,
                response: PixelResponse {
                    threshold: Threshold::new(q)?,
                    light_per_intensity: 1.0,
                    max_intensity: 1.0,
                },
                jot: JotResponse {
                    efficiency: 1.0,
                    dark_counts: 0.0,
                },
            };
            assert_eq!(sensor.may_have_dark_regions(image.view()), expected);
        }
        Ok(())
    }
}
