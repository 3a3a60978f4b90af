//! Dim scenes: a network sees several of their trials as one.
//!
//! In a dim scene, ones are rare. Then c trials are like one trial whose probability of a one is c
//! times as large: in both cases, the number of ones is nearly a Poisson number. Networks were trained
//! for brighter scenes, and hardly any probability that they return is below 1e-4.

use ndarray::{Array2, ArrayView2, Zip};
use rayon::prelude::*;

use super::SensorModel;
use super::local_trials::LocalTrials;
use crate::error::Result;

/// The smallest number of trials that remains.
const MIN_TRIALS: u32 = 4;

/// The smallest ratio of combined trials to ones, which nearly all pixels keep.
const ROOM: f64 = 4.0;

/// The fraction of the pixels for which there is this room.
const NEARLY_ALL: f64 = 0.999;

/// The smallest number of trials per combined trial.
const MIN_FACTOR: f64 = 1.5;

/// The probability of a one of combined trials up to which only they are used, and that from which
/// they are not used. In between, both estimates have weights.
const USED: f32 = 0.25;
/// See [`USED`].
const FULL: f32 = 0.5;

/// The brightest fractions are assumed to exceed the estimate by this number of standard deviations.
const NOISE: f64 = 1.0;

/// The fraction of ones of the brightest pixels below which trials may be combined.
const DIM: f64 = 1.0 / (ROOM * MIN_FACTOR);

impl SensorModel {
    /// Return whether an image of intensities is so dark that trials may be combined.
    ///
    /// `trials` is the number of trials of a pixel.
    #[must_use]
    pub fn may_be_dim(&self, image: ArrayView2<'_, f32>, trials: f64) -> bool {
        if trials < MIN_FACTOR * f64::from(MIN_TRIALS) {
            return false;
        }
        let is_dim = |intensity| {
            let p = self.detection_probability(intensity);
            // The fractions of nearly all pixels are below a limit that is above p by this noise.
            p + NOISE * (p * (1.0 - p) / trials).sqrt() < DIM
        };
        // The mean takes less time, and most scenes are too bright.
        is_dim(mean(image)) && is_dim(quantile(image, NEARLY_ALL))
    }
}

/// The trials of a dim scene, several of which are one.
#[derive(Clone, Debug)]
pub struct Combined {
    /// The fractions of ones.
    pub fractions: Array2<f32>,
    /// The local trials.
    pub trials: LocalTrials,
    /// c, the number of trials per combined trial.
    pub factor: f32,
}

impl Combined {
    /// Return the combined trials of an image with fractions of ones, or None for a scene that is not
    /// dim. `smallest` is the smallest K of the network.
    ///
    /// # Errors
    /// [`crate::error::Error::Shape`] if a map of trials has another shape.
    pub fn of(
        fractions: ArrayView2<'_, f32>,
        trials: &LocalTrials,
        smallest: u32,
    ) -> Result<Option<Self>> {
        trials.check_shape(fractions.dim())?;
        let factor = trials_per_combined(fractions, trials, smallest);
        if factor < MIN_FACTOR {
            return Ok(None);
        }
        let (trials, factor) = match trials {
            LocalTrials::Same(trials) => {
                let number = (f64::from(*trials) / factor).round_ties_even() as u32;
                let number = number.max(MIN_TRIALS).max(smallest);
                let factor = f64::from(*trials) / f64::from(number);
                (LocalTrials::Same(number), factor as f32)
            }
            LocalTrials::Map(map) => {
                let factor = factor as f32;
                let map = map.mapv(|trials| (trials / factor).max(1.0));
                (LocalTrials::Map(map.into_shared()), factor)
            }
        };
        Ok(Some(Self {
            fractions: fractions.mapv(|fraction| (fraction * factor).min(1.0)),
            trials,
            factor,
        }))
    }

    /// Return the weight of these trials in each pixel, from 0 to 1. The other estimate is that of
    /// all trials.
    ///
    /// In bright pixels, such as stars, combined trials are nearly all ones and say nothing. Around
    /// them, they are better: a network for all trials may return a sky that is far too bright.
    /// Networks may blur bright pixels, so the fractions of ones count, too.
    ///
    /// `probabilities` are the estimated probabilities of a one of combined trials.
    ///
    /// # Errors
    /// [`crate::error::Error::Shape`] if the shapes do not match.
    pub fn weights(&self, probabilities: ArrayView2<'_, f32>) -> Result<Array2<f32>> {
        let shape = self.fractions.dim();
        if probabilities.dim() != shape {
            let received = probabilities.dim();
            return Err(crate::error::Error::shape("probabilities", shape, received));
        }
        let weight = |&p: &f32, &fraction: &f32| {
            let bright = p.max(fraction / 2.0);
            ((FULL - bright) / (FULL - USED)).clamp(0.0, 1.0)
        };
        Ok(Zip::from(probabilities)
            .and(&self.fractions)
            .par_map_collect(weight))
    }
}

/// Return c, the number of trials per combined trial, or 1 for scenes that are not dim.
///
/// `fractions` are the fractions of ones, and `smallest` is the smallest K of the network.
///
/// # Examples
/// ```
/// use jotlight::network::{LocalTrials, trials_per_combined};
/// use ndarray::Array2;
///
/// let (dim, trials) = (Array2::from_elem((8, 8), 1.0 / 256.0), LocalTrials::Same(256));
/// assert_eq!(trials_per_combined(dim.view(), &trials, 1), 64.0);
/// let brighter = 32.0 * dim;
/// assert_eq!(trials_per_combined(brighter.view(), &trials, 1), 2.0);
/// ```
#[must_use]
pub fn trials_per_combined(
    fractions: ArrayView2<'_, f32>,
    trials: &LocalTrials,
    smallest: u32,
) -> f64 {
    let bright = quantile(fractions, NEARLY_ALL);
    let typical = match trials {
        LocalTrials::Same(trials) => f64::from(*trials),
        LocalTrials::Map(map) => quantile(map.view(), 0.5),
    };
    let remaining = f64::from(MIN_TRIALS.max(smallest));
    let factor = (typical / remaining).min(1.0 / (ROOM * bright).max(1.0 / typical));
    if factor >= MIN_FACTOR { factor } else { 1.0 }
}

/// Return the mean of an image, which does not depend on the number of threads.
pub(super) fn mean(image: ArrayView2<'_, f32>) -> f64 {
    let sum = |row: usize| image.row(row).iter().copied().map(f64::from).sum();
    let rows: Vec<f64> = (0..image.nrows()).into_par_iter().map(sum).collect();
    rows.iter().sum::<f64>() / image.len() as f64
}

/// Return the number below which a fraction of the values of an image lies, interpolated linearly. It
/// is 0 for an image without pixels.
fn quantile(image: ArrayView2<'_, f32>, fraction: f64) -> f64 {
    let mut values: Vec<f32> = image.iter().copied().collect();
    let Some(last) = values.len().checked_sub(1) else {
        return 0.0;
    };
    let place = fraction * last as f64;
    let (_, &mut low, above) = values.select_nth_unstable_by(place as usize, f32::total_cmp);
    let high = above.iter().copied().min_by(f32::total_cmp).unwrap_or(low);
    f64::from(low) + place.fract() * f64::from(high - low)
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;
    use crate::likelihood::Threshold;
    use crate::mle::{JotResponse, PixelResponse};

    #[test]
    fn quantiles_are_interpolated() {
        let image = array![[3.0, 0.0], [1.0, 7.0], [2.0, 5.0]];
        for (fraction, expected) in [(0.0, 0.0), (0.5, 2.5), (0.9, 6.0), (1.0, 7.0)] {
            assert!((quantile(image.view(), fraction) - expected).abs() < 1e-12);
        }
        assert!(quantile(Array2::zeros((0, 3)).view(), 0.5).abs() < 1e-12);
    }

    #[test]
    fn combined_trials_have_the_same_ones() -> Result<()> {
        let fractions = Array2::from_shape_fn((20, 30), |(y, x)| ((y * 7 + x) % 3) as f32 / 256.0);
        let map = Array2::from_shape_fn((20, 30), |(y, _)| 200.0 + y as f32).into_shared();
        for trials in [LocalTrials::Same(256), LocalTrials::Map(map)] {
            let Some(found) = Combined::of(fractions.view(), &trials, 1)? else {
                return Err(crate::error::Error::range("scene", "a dim one", "another"));
            };
            assert!(found.factor > 20.0);
            let products = found.trials.to_array().mapv(|trials| trials * found.factor);
            let own = trials.to_array();
            assert!(products.iter().zip(&own).all(|(a, b)| (a - b).abs() < 1e-3));
            let scaled = &fractions * found.factor;
            assert_eq!(found.fractions, scaled);
        }
        // Networks may need more trials than remain otherwise.
        let few = Combined::of(fractions.view(), &LocalTrials::Same(256), 64)?;
        assert!(few.is_some_and(|few| matches!(few.trials, LocalTrials::Same(64))));
        Ok(())
    }

    #[test]
    fn bright_scenes_keep_their_trials() -> Result<()> {
        let bright = Array2::from_elem((8, 8), 0.2);
        let none = Combined::of(bright.view(), &LocalTrials::Same(256), 1)?;
        assert!(none.is_none());
        let one = |light_per_intensity| -> Result<SensorModel> {
            Ok(SensorModel {
                trials: 64,
                response: PixelResponse {
                    threshold: Threshold::new(1)?,
                    light_per_intensity,
                    max_intensity: 1.0,
                },
                jot: JotResponse {
                    efficiency: 1.0,
                    dark_counts: 0.0,
                },
            })
        };
        let image = Array2::from_elem((8, 8), 0.5);
        assert!(!one(1.0)?.may_be_dim(image.view(), 64.0));
        assert!(one(0.03)?.may_be_dim(image.view(), 64.0));
        assert!(!one(0.03)?.may_be_dim(image.view(), 5.0));
        Ok(())
    }

    #[test]
    fn combined_trials_weigh_less_in_bright_pixels() -> Result<()> {
        let combined = Combined {
            fractions: array![[0.0, 0.5, 1.0, 1.0]],
            trials: LocalTrials::Same(4),
            factor: 8.0,
        };
        let found = combined.weights(array![[0.01, 0.375, 0.9, 0.01]].view())?;
        assert_eq!(found, array![[1.0, 0.5, 0.0, 0.0]]);
        assert!(combined.weights(array![[0.0]].view()).is_err());
        Ok(())
    }
}
