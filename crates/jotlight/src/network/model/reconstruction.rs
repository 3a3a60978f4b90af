//! The reconstruction of images from the bits or counts of one sensor.

use std::sync::Arc;

use ndarray::{Array2, ArrayView2, ArrayViewMut2, Zip};
use rayon::prelude::*;

use super::denoise::{Denoiser, run_counts, tied_weights};
use super::levels::{LocalTrials, local_trials};
use super::{Network, SensorModel, Served};
use crate::bits::{PackedBits, add_block_counts};
use crate::error::{Error, Result};
use crate::mle::{self, JotResponses};
use crate::network::forward::{forward_bits, forward_counts, forward_tied_bits};
use crate::network::layer::Layer;
use crate::values::Values;

/// The number of pixels whose probabilities become intensities in one task.
const PIXELS_PER_TASK: usize = 1 << 12;

/// The largest relative difference of light and S of a sensor and that of a network for one K.
const TOLERANCE: f64 = 1e-9;

/// A network, prepared for the data of one sensor.
#[derive(Debug)]
pub struct Reconstruction<'a> {
    network: &'a Network,
    sensor: SensorModel,
    /// Whether the network estimates P(b = 0), and not P(b = 1).
    zeros: bool,
    /// The layers for K, or None where K exceeds the range of the network.
    layers: Option<Arc<Vec<Layer<f32>>>>,
}

impl<'a> Reconstruction<'a> {
    pub(super) fn new(network: &'a Network, sensor: SensorModel) -> Result<Self> {
        let max = match network.served {
            Served::Trials { min, max } => {
                if sensor.trials < min {
                    let expected = format!("{min} or more, the smallest K of the network");
                    return Err(Error::range("trials per pixel", expected, sensor.trials));
                }
                max
            }
            Served::Sensor(own) => {
                check_served(&own, &sensor)?;
                sensor.trials
            }
        };
        let zeros = network.estimates_zeros(&sensor);
        let layers = if sensor.trials <= max {
            Some(network.layers_for(sensor.trials, zeros)?)
        } else {
            None
        };
        Ok(Self {
            network,
            sensor,
            zeros,
            layers,
        })
    }

    /// Write the image of counts L from 0 to K into `out`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes do not match. [`Error::Range`] for a count outside of 0 to K,
    /// and for networks that weigh each jot of a pixel.
    pub fn counts(
        &self,
        counts: ArrayView2<'_, i32>,
        mut out: ArrayViewMut2<'_, f32>,
    ) -> Result<()> {
        self.check_tied()?;
        match &self.layers {
            Some(layers) if (self.sensor.trials as usize) < counts.len() => {
                let table = self.table(layers)?;
                let layers: Vec<_> = layers.iter().collect();
                forward_counts(&layers, counts, table.view(), out.view_mut())?;
                self.to_intensities(out)
            }
            Some(layers) => {
                let equivalent = self.equivalent_counts(counts)?;
                self.assign(run_counts(layers, equivalent.view())?, out)
            }
            None => {
                let trials = LocalTrials::Same(self.sensor.trials);
                let trials_of_pixels = f64::from(self.sensor.trials);
                let fractions = self.fractions(counts, |_| trials_of_pixels)?;
                self.assign(self.denoiser()?.denoise(fractions.view(), &trials)?, out)
            }
        }
    }

    /// Write the image of counts L with a number of trials for each pixel into `out`.
    ///
    /// Only networks for many K take different numbers of trials.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes do not match. [`Error::Range`] for trials that are not above
    /// 0, a count outside of 0 to its trials, and networks for one K.
    pub fn counts_of_trials(
        &self,
        counts: ArrayView2<'_, i32>,
        trials: ArrayView2<'_, f64>,
        out: ArrayViewMut2<'_, f32>,
    ) -> Result<()> {
        if counts.dim() != trials.dim() {
            return Err(Error::shape("trials", counts.dim(), trials.dim()));
        }
        if let Some(&trials) = trials.iter().find(|&&n| !(n > 0.0 && n.is_finite())) {
            let expected = "finite numbers above 0; fill pixels without readings before";
            return Err(Error::range("trials", expected, trials));
        }
        let denoiser = self.denoiser()?;
        let fractions = self.fractions(counts, |place| trials[place])?;
        let local = local_trials(trials);
        match local {
            LocalTrials::Same(level) if (denoiser.range.0..=denoiser.range.1).contains(&level) => {
                let layers = self.network.layers_for(level, self.zeros)?;
                let level = f64::from(level);
                let mut equivalent = Array2::zeros(counts.dim());
                Zip::from(&mut equivalent).and(counts).and(trials).for_each(
                    |out, &ones, &trials| {
                        *out = (level * (f64::from(ones) / trials)) as f32;
                    },
                );
                self.assign(run_counts(&layers, equivalent.view())?, out)
            }
            local => self.assign(denoiser.denoise(fractions.view(), &local)?, out),
        }
    }

    /// Write the image of the bits of K̂ × K̂ jots per pixel into `out`.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if the shapes do not match, or the number of bits of a
    /// pixel is not K.
    pub fn bits(
        &self,
        bits: &PackedBits<'_>,
        oversampling: usize,
        mut out: ArrayViewMut2<'_, f32>,
    ) -> Result<()> {
        let size = bits.pixel_shape(oversampling)?;
        let trials = crate::bits::trials(bits.shape().0, oversampling)?.cast_unsigned();
        if trials != self.sensor.trials {
            let expected = format!("{}, that of the sensor", self.sensor.trials);
            return Err(Error::range("trials per pixel", expected, trials));
        }
        match &self.layers {
            Some(layers) if !self.network.is_tied() => {
                let layers: Vec<_> = layers.iter().collect();
                forward_bits(&layers, bits, out.view_mut())?;
                self.to_intensities(out)
            }
            Some(layers) if (trials as usize) < size.0 * size.1 => {
                let table = self.table(layers)?;
                let layers: Vec<_> = layers.iter().collect();
                forward_tied_bits(&layers, bits, oversampling, table.view(), out.view_mut())?;
                self.to_intensities(out)
            }
            _ => {
                let mut counts = Array2::zeros(size);
                add_block_counts(bits, oversampling, None, counts.view_mut())?;
                self.counts(counts.view(), out)
            }
        }
    }

    fn check_tied(&self) -> Result<()> {
        if self.network.is_tied() {
            return Ok(());
        }
        let expected = "bits, because this network weighs each jot of a pixel";
        Err(Error::range("data", expected, "counts"))
    }

    fn denoiser(&self) -> Result<Denoiser<'_>> {
        let Served::Trials { min, max } = self.network.served else {
            let expected = "a network for many K";
            return Err(Error::range("network", expected, "one for a single K"));
        };
        Ok(Denoiser {
            network: self.network,
            zeros: self.zeros,
            range: (min, max),
        })
    }

    /// Return the sum p of the first layer for each count from 0 to K, `(C, K + 1)`.
    fn table(&self, layers: &[Layer<f32>]) -> Result<Array2<f32>> {
        let counts = Array2::from_shape_fn((1, self.sensor.trials as usize + 1), |(_, k)| k as i32);
        let counts = self.equivalent_counts(counts.view())?;
        let weights = tied_weights(layers);
        let shape = (weights.len(), counts.ncols());
        Ok(Array2::from_shape_fn(shape, |(channel, k)| {
            weights[channel] * counts[[0, k]]
        }))
    }

    /// Return the counts that the jots for which the layers were made would show.
    fn equivalent_counts(&self, counts: ArrayView2<'_, i32>) -> Result<Array2<f32>> {
        let trials = f64::from(self.sensor.trials);
        let mut reference = self.sensor.jot;
        if let Served::Sensor(own) = self.network.served {
            // The check has established that both sensors detect equal light at intensity 1.
            reference.dark_counts = own.jot.dark_counts;
        }
        let jots = JotResponses {
            efficiency: Values::Same(self.sensor.jot.efficiency),
            dark_counts: Values::Same(self.sensor.jot.dark_counts),
        };
        let counts = counts.as_standard_layout();
        let mut out = Array2::zeros(counts.dim());
        mle::equivalent_counts(
            &self.sensor.response,
            counts.as_slice().unwrap_or_default(),
            Values::Same(trials),
            &jots,
            trials,
            reference,
            out.as_slice_mut().unwrap_or_default(),
        )?;
        Ok(out)
    }

    /// Return the fractions of ones of each pixel, or of zeros.
    fn fractions(
        &self,
        counts: ArrayView2<'_, i32>,
        trials: impl Fn((usize, usize)) -> f64,
    ) -> Result<Array2<f32>> {
        let invalid = counts
            .indexed_iter()
            .find(|&(place, &ones)| ones < 0 || f64::from(ones) > trials(place));
        if let Some((place, ones)) = invalid {
            let expected = format!("0 to {}, the trials of the pixel", trials(place));
            return Err(Error::range("counts", expected, ones));
        }
        Ok(Array2::from_shape_fn(counts.dim(), |place| {
            let fraction = (f64::from(counts[place]) / trials(place)) as f32;
            if self.zeros { 1.0 - fraction } else { fraction }
        }))
    }

    /// Write an image of probabilities as intensities.
    fn assign(&self, image: Array2<f32>, mut out: ArrayViewMut2<'_, f32>) -> Result<()> {
        if image.dim() != out.dim() {
            return Err(Error::shape("out", image.dim(), out.dim()));
        }
        out.assign(&image);
        self.to_intensities(out)
    }

    /// Replace the outputs of the network with intensities in [0, S].
    fn to_intensities(&self, mut out: ArrayViewMut2<'_, f32>) -> Result<()> {
        let Some(out) = out.as_slice_mut() else {
            let expected = "contiguous rows";
            return Err(Error::shape("out", expected, "another memory layout"));
        };
        let response = &self.sensor.response;
        let max = response.max_intensity as f32;
        let is_conditional = matches!(self.network.served, Served::Trials { .. });
        out.par_chunks_mut(PIXELS_PER_TASK).try_for_each(|out| {
            if !is_conditional {
                for intensity in out.iter_mut() {
                    *intensity = intensity.clamp(0.0, max);
                }
                return Ok(());
            }
            if self.zeros {
                for value in out.iter_mut() {
                    *value = self.intensity_of_complement(*value);
                }
                return Ok(());
            }
            let probabilities = out.to_vec();
            mle::from_probability(response, &probabilities, self.sensor.jot, out)
        })
    }

    /// Return the intensity at which bits are 0 with the given probability, for the threshold 1.
    fn intensity_of_complement(&self, complement: f32) -> f32 {
        let rate = 0.0 - f64::from(complement.clamp(0.0, 1.0)).ln();
        let intensity = (rate - self.sensor.jot.dark_counts) / self.sensor.detected_light();
        intensity.clamp(0.0, self.sensor.response.max_intensity) as f32
    }
}

/// Check that a network for one K serves a sensor.
fn check_served(own: &SensorModel, sensor: &SensorModel) -> Result<()> {
    let close = |a: f64, b: f64| (a - b).abs() <= TOLERANCE * a.abs().max(b.abs());
    let parameters = |sensor: &SensorModel| {
        format!(
            "K = {}, q = {}, {} detections at intensity 1, and S = {}",
            sensor.trials,
            sensor.response.threshold.photons(),
            sensor.detected_light(),
            sensor.response.max_intensity
        )
    };
    let is_same = own.trials == sensor.trials
        && own.response.threshold.photons() == sensor.response.threshold.photons()
        && close(own.detected_light(), sensor.detected_light())
        && close(own.response.max_intensity, sensor.response.max_intensity);
    if is_same {
        return Ok(());
    }
    Err(Error::range(
        "sensor",
        format!("that of the network, {}", parameters(own)),
        parameters(sensor),
    ))
}
