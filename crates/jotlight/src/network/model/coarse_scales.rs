//! Few photons: a network sees the coarse structure of a scene in squares of pixels.
//!
//! A network sees the neighborhood of a pixel. If all of it holds only a few ones, its mean light is
//! uncertain, and the estimate is too bright or has spots. Squares of 2 × 2 pixels have four times as
//! many ones, and a network sees twice as far in them. So the probability p of a one gains what the
//! squares say about its coarse structure:
//!
//! ```text
//! p + enlarge(w (p' - mean of p over the square)),    w = 1 / (1 + 2 I),
//! ```
//!
//! where p' is the probability of a square, and I is the Fisher information of a pixel about the
//! logarithm of its intensity. In dim scenes, I is the expected number of detected photons. The
//! result is at least the smaller one of p and p'. Squares may gain from squares of squares in the
//! same way.

use ndarray::{Array2, ArrayView2, ArrayViewMut2, Zip};

use super::dim_scenes::mean;
use super::enlarge::enlarge;
use super::pixels::Pixels;
use super::reconstruction::Reconstruction;
use super::squares::{OfSquares, Squares, sum_squares};
use super::{SensorModel, Served};
use crate::error::{Error, Result};
use crate::values::Values;

/// The detected photons of a pixel above which squares say too little to be worth their time.
const FEW: f64 = 3.0;

/// The smallest height and width of an image, in pixels, that has squares.
const MIN_SIDE: usize = 32;

/// The largest count of which four are a count, too.
const MAX_COUNT: i32 = i32::MAX / 4;

/// The smallest intensity at which the information is evaluated.
const MIN_INTENSITY: f64 = 1e-12;

/// The smallest rate at which the information is evaluated.
const MIN_RATE: f64 = 1e-150;

impl SensorModel {
    /// Return whether an image of intensities gains from squares of pixels.
    ///
    /// `trials` is the usual number of trials of a pixel. Sensors whose squares may have more ones than
    /// an `i32` holds have no squares.
    #[must_use]
    pub fn has_few_photons(&self, image: ArrayView2<'_, f32>, trials: f64) -> bool {
        let is_small = image.nrows().min(image.ncols()) < MIN_SIDE;
        if is_small || self.trials > MAX_COUNT.cast_unsigned() {
            return false;
        }
        let mean = mean(image);
        let light = self.detected_light() * mean;
        let photons = light * trials;
        let q = self.response.threshold.photons();
        // With fewer photons than its threshold, a jot hardly reports them.
        if q > 1 && light < f64::from(q) {
            return photons.min(self.log_information(mean, trials)) < FEW;
        }
        photons < FEW
    }

    /// Return the sensor of squares of 2 × 2 pixels, where [`Self::has_few_photons`] is true.
    fn of_squares(&self) -> Self {
        let trials = self.trials.saturating_mul(4);
        Self { trials, ..*self }
    }

    /// Return the Fisher information of a pixel about the logarithm of its intensity.
    fn log_information(&self, intensity: f64, trials: f64) -> f64 {
        let intensity = intensity.max(MIN_INTENSITY);
        // The light that is detected, per frame.
        let light = self.detected_light() * intensity;
        let rate = (light + self.jot.dark_counts).max(MIN_RATE);
        let threshold = &self.response.threshold;
        let scores = threshold.detection_score(rate) * threshold.non_detection_score(rate);
        light * light * trials * scores
    }
}

impl Reconstruction<'_> {
    /// Return whether [`Self::add_squares`] changes an image.
    pub(super) fn has_few_photons(&self, image: ArrayView2<'_, f32>, trials: f64) -> bool {
        let is_conditional = matches!(self.network.served, Served::Trials { .. });
        is_conditional && self.sensor.has_few_photons(image, trials)
    }

    /// Correct the coarse structure of an image of few photons by squares of its pixels.
    pub(super) fn add_squares(
        &self,
        mut image: ArrayViewMut2<'_, f32>,
        pixels: &Pixels<'_>,
    ) -> Result<()> {
        let usual = match pixels.trials {
            Values::Same(trials) => trials,
            Values::Each(trials) => trials.iter().sum::<f64>() / trials.len() as f64,
        };
        // Some pixels may have more trials than the sensor.
        let are_countable = || pixels.counts.iter().all(|&count| count <= MAX_COUNT);
        if !self.has_few_photons(image.view(), usual) || !are_countable() {
            return Ok(());
        }
        let squares = Squares::of(pixels, self.sensor.response.threshold)?;
        let sensor = self.sensor.of_squares();
        let mut coarse = Array2::zeros(squares.counts.dim());
        let reconstruction = self.network.prepare(sensor)?;
        reconstruction.pixels(&squares.pixels(), coarse.view_mut())?;
        let found = add_coarse(image.view(), coarse.view(), &sensor, &squares.trials)?;
        image.assign(&found);
        Ok(())
    }
}

/// Return an image that gains what squares of pixels say about its coarse structure.
///
/// `fine` are the intensities of the pixels, and `coarse` those of the squares. `sensor` is that of
/// the squares, and `trials` are their numbers of bits.
///
/// # Errors
/// [`Error::Shape`] if the shapes do not match.
pub fn add_coarse(
    fine: ArrayView2<'_, f32>,
    coarse: ArrayView2<'_, f32>,
    sensor: &SensorModel,
    trials: &OfSquares,
) -> Result<Array2<f32>> {
    let (height, width) = fine.dim();
    let shape = (height.div_ceil(2), width.div_ceil(2));
    if coarse.dim() != shape {
        return Err(Error::shape("coarse", shape, coarse.dim()));
    }
    let trials = match trials {
        OfSquares::Same(trials) => Array2::from_elem((1, 1), *trials),
        OfSquares::Each(map) if map.dim() == shape => map.clone(),
        OfSquares::Each(map) => return Err(Error::shape("trials", shape, map.dim())),
    };
    let probability = |&c: &f32| sensor.detection_probability(f64::from(c));
    let p = Zip::from(fine).par_map_collect(probability);
    let of_squares = Zip::from(coarse).par_map_collect(probability);
    let mut change = sum_squares(p.view(), |p| p);
    Zip::from(&mut change)
        .and(&of_squares)
        .and(coarse)
        .and_broadcast(&trials)
        .par_for_each(|change, &square, &intensity, &trials| {
            let of_pixel = sensor.log_information(f64::from(intensity), trials / 4.0);
            *change = (square - *change / 4.0) / (1.0 + 2.0 * of_pixel);
        });
    let change = enlarge(change.view());
    let mut out = Array2::zeros(fine.dim());
    Zip::indexed(&mut out)
        .and(&p)
        .par_for_each(|(row, column), out, &p| {
            // Next to bright pixels, the change may exceed p. Both estimates say that there is more
            // light.
            let least = p.min(of_squares[[row / 2, column / 2]]);
            let found = (p + change[[row, column]]).clamp(0.0, 1.0).max(least);
            *out = sensor.response.intensity(found, sensor.jot) as f32;
        });
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood::Threshold;
    use crate::mle::{JotResponse, PixelResponse};

    fn sensor(q: u32, light: f64, dark_counts: f64) -> Result<SensorModel> {
        Ok(SensorModel {
            trials: 8,
            response: PixelResponse {
                threshold: Threshold::new(q)?,
                light_per_intensity: light,
                max_intensity: 1.0,
            },
            jot: JotResponse {
                efficiency: 0.6,
                dark_counts,
            },
        })
    }

    #[test]
    fn the_information_is_that_of_the_likelihood() -> Result<()> {
        // It is the mean of the squared derivative by the logarithm, by finite differences.
        let step = 1e-5f64;
        for q in [1, 2] {
            let sensor = sensor(q, 1.5, 0.3)?;
            for intensity in [0.01, 0.4, 1.0] {
                let p = |shift: f64| sensor.detection_probability(intensity * shift.exp());
                let slope = (p(step) - p(-step)) / (2.0 * step);
                let expected = 8.0 * slope * slope / (p(0.0) * (1.0 - p(0.0)));
                let found = sensor.log_information(intensity, 8.0);
                assert!((found / expected - 1.0).abs() < 1e-6);
            }
        }
        Ok(())
    }

    #[test]
    fn few_photons_are_counted_without_dark_counts() -> Result<()> {
        let image = Array2::from_elem((32, 40), 0.5);
        // 0.6 * 0.5 * 8 = 2.4 photons are detected at a light of 1.
        assert!(sensor(1, 1.0, 5.0)?.has_few_photons(image.view(), 8.0));
        assert!(!sensor(1, 1.3, 5.0)?.has_few_photons(image.view(), 8.0));
        let small = image.slice(ndarray::s![..31, ..]);
        assert!(!sensor(1, 1.0, 5.0)?.has_few_photons(small, 8.0));
        // Behind a threshold, hardly any of these photons are reported.
        assert!(sensor(3, 1.3, 0.0)?.has_few_photons(image.view(), 8.0));
        Ok(())
    }

    #[test]
    fn a_sensor_whose_squares_may_have_too_many_ones_has_none() -> Result<()> {
        let image = Array2::from_elem((32, 40), 0.5);
        for (trials, expected) in [(i32::MAX as u32 / 4, true), (1 << 29, false)] {
            let sensor = SensorModel {
                trials,
                ..sensor(1, 1e-10, 0.5)?
            };
            assert_eq!(
                sensor.has_few_photons(image.view(), f64::from(trials)),
                expected
            );
        }
        Ok(())
    }

    #[test]
    fn a_constant_image_moves_toward_that_of_the_squares() -> Result<()> {
        let sensor = sensor(1, 1.0, 0.0)?;
        let p = |c: f64| 1.0 - (-0.6 * c).exp();
        for (height, width) in [(32, 40), (33, 41)] {
            let fine = Array2::from_elem((height, width), 0.3);
            let coarse = Array2::from_elem((height.div_ceil(2), width.div_ceil(2)), 0.5);
            for (trials, weight) in [
                (
                    4.0,
                    1.0 / (1.0 + 2.0 * 0.3f64.powi(2) / (0.3f64.exp() - 1.0)),
                ),
                // If a pixel has many photons, squares say nothing new.
                (4e9, 0.0),
            ] {
                let same = OfSquares::Same(trials);
                let found = add_coarse(fine.view(), coarse.view(), &sensor, &same)?;
                let expected = -(1.0 - p(0.3) - weight * (p(0.5) - p(0.3))).ln() / 0.6;
                assert!(
                    found
                        .iter()
                        .all(|&c| (f64::from(c) - expected).abs() < 1e-6)
                );
                let each = OfSquares::Each(Array2::from_elem(coarse.dim(), trials));
                assert_eq!(
                    add_coarse(fine.view(), coarse.view(), &sensor, &each)?,
                    found
                );
            }
            assert!(add_coarse(fine.view(), fine.view(), &sensor, &OfSquares::Same(4.0)).is_err());
        }
        Ok(())
    }
}
