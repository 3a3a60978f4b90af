//! The reconstruction of images from the bits or counts of one sensor.

use ndarray::{Array2, ArrayView2, ArrayView3, ArrayViewMut2};

use super::local_trials::LocalTrials;
use super::pixels::{EquivalentCounts, Pixels};
use super::{Network, SensorModel, Served};
use crate::bits::{PackedBits, add_block_counts};
use crate::error::{Error, Result};
use crate::mle::{JotResponse, JotResponses};
use crate::network::forward::{forward, forward_bits, forward_counts, forward_tied_bits};
use crate::values::Values;

/// The largest relative difference of light and S of a sensor and that of a network for one K.
const TOLERANCE: f64 = 1e-9;

/// A network, prepared for the data of one sensor.
#[derive(Debug)]
pub struct Reconstruction<'a> {
    pub(super) network: &'a Network,
    pub(super) sensor: SensorModel,
    /// Whether the network estimates P(b = 0), and not P(b = 1).
    pub(super) zeros: bool,
}

impl<'a> Reconstruction<'a> {
    pub(super) fn new(network: &'a Network, sensor: SensorModel) -> Result<Self> {
        sensor.check()?;
        match network.served {
            Served::Trials { min, .. } if sensor.trials < min => {
                let expected = format!("{min} or more, the smallest K of the network");
                return Err(Error::range("trials per pixel", expected, sensor.trials));
            }
            Served::Trials { .. } => {}
            Served::Sensor(own) => check_served(&own, &sensor)?,
            Served::Planes { .. } => {
                let expected = "a network for intensities";
                return Err(Error::range("network", expected, "one for planes"));
            }
        }
        Ok(Self {
            network,
            sensor,
            zeros: network.estimates_zeros(&sensor),
        })
    }

    /// Write the image of counts L from 0 to K into `out`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes do not match, or the rows of `out` are not contiguous.
    /// [`Error::Range`] for a count outside of 0 to K, and for networks that weigh each jot of a pixel.
    pub fn counts(&self, counts: ArrayView2<'_, i32>, out: ArrayViewMut2<'_, f32>) -> Result<()> {
        self.pixels(&self.alike(counts), out)
    }

    /// Return the pixels of counts of the sensor.
    fn alike<'c>(&self, counts: ArrayView2<'c, i32>) -> Pixels<'c> {
        Pixels {
            counts,
            trials: Values::Same(f64::from(self.sensor.trials)),
            jots: same_jots(self.sensor.jot),
        }
    }

    /// Write the image of counts L with a number of trials for each pixel into `out`.
    ///
    /// Only networks for many K take different numbers of trials.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes do not match, or the rows of `out` are not contiguous.
    /// [`Error::Range`] for trials that are not above 0, a count outside of 0 to its trials, and
    /// networks for one K.
    pub fn counts_of_trials(
        &self,
        counts: ArrayView2<'_, i32>,
        trials: ArrayView2<'_, f64>,
        out: ArrayViewMut2<'_, f32>,
    ) -> Result<()> {
        if counts.dim() != trials.dim() {
            return Err(Error::shape("trials", counts.dim(), trials.dim()));
        }
        let trials = trials.as_standard_layout();
        let pixels = Pixels {
            counts,
            trials: Values::Each(trials.as_slice().unwrap_or_default()),
            jots: same_jots(self.sensor.jot),
        };
        self.pixels(&pixels, out)
    }

    /// Write the image of counts of pixels that may differ in their trials and their response to
    /// light into `out`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes do not match, or the rows of `out` are not contiguous.
    /// [`Error::Range`] for trials that are not above 0, a count outside of 0 to its trials, different
    /// trials for networks for one K, and networks that weigh each jot of a pixel.
    pub fn pixels(&self, pixels: &Pixels<'_>, mut out: ArrayViewMut2<'_, f32>) -> Result<()> {
        let local = self.local_trials_of(pixels)?;
        let level = self.level(&local);
        let of = level.unwrap_or(1);
        let has_table = match (
            pixels.trials,
            pixels.jots.efficiency,
            pixels.jots.dark_counts,
        ) {
            (Values::Same(trials), Values::Same(_), Values::Same(_)) => {
                self.network.rotations == 1 && trials < pixels.counts.len() as f64
            }
            _ => false,
        };
        if has_table && level.is_some() && self.network.is_tied() {
            let layers = self.network.layers_for(f64::from(of), self.zeros)?;
            let table = self.table(&layers, pixels, of)?;
            self.write(out.view_mut(), |out| {
                let layers: Vec<_> = layers.iter().collect();
                forward_counts(&layers, pixels.counts, table.view(), out)
            })?;
            return self.correct(out, pixels, &local);
        }
        let equivalent = self.equivalent(pixels, of)?;
        let counts = EquivalentCounts {
            counts: equivalent.view(),
            of,
            trials: local,
        };
        self.equivalent_counts(&[counts], vec![out.view_mut()])?;
        self.add_squares(out, pixels)
    }

    /// Write the image of the bits of K̂ × K̂ jots per pixel into `out`.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if the shapes do not match, the rows of `out` are not
    /// contiguous, or the number of bits of a pixel is not K.
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
        if !self.network.is_tied() {
            let layers = self.network.layers_for(f64::from(trials), self.zeros)?;
            let layers: Vec<_> = layers.iter().collect();
            return self.write(out, |out| forward_bits(&layers, bits, out));
        }
        let local = LocalTrials::Same(trials);
        let level = self.level(&local);
        if self.network.rotations == 1
            && let Some(level) = level
            && (trials as usize) < size.0 * size.1
        {
            let layers = self.network.layers_for(f64::from(level), self.zeros)?;
            let none = Array2::zeros((1, 1));
            let table = self.table(&layers, &self.alike(none.view()), level)?;
            let layers: Vec<_> = layers.iter().collect();
            self.write(out.view_mut(), |out| {
                forward_tied_bits(&layers, bits, oversampling, table.view(), out)
            })?;
            if !self.may_need_correction(out.view()) {
                return Ok(());
            }
            let counts = count_ones(bits, oversampling)?;
            return self.correct(out, &self.alike(counts.view()), &local);
        }
        self.counts(count_ones(bits, oversampling)?.view(), out)
    }

    /// Write the image of the sums of the first layer of a network for one sensor, `(C, H, W)`, into
    /// `out`. [`Network::masked_sums`] returns such sums.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes do not match, or the rows of `out` are not contiguous.
    pub fn sums(&self, sums: ArrayView3<'_, f32>, out: ArrayViewMut2<'_, f32>) -> Result<()> {
        let layers = self.network.layers_for(self.network.own_trials()?, false)?;
        let layers: Vec<_> = layers.iter().collect();
        self.write(out, |out| forward(&layers, sums, out))
    }

    /// Write the output of the last layer, and replace it with intensities.
    fn write(
        &self,
        mut out: ArrayViewMut2<'_, f32>,
        evaluate: impl FnOnce(ArrayViewMut2<'_, f32>) -> Result<()>,
    ) -> Result<()> {
        evaluate(out.view_mut())?;
        self.to_intensities(out)
    }

    /// Return the K whose layers serve the local trials of an image, or None if it takes several.
    pub(super) fn level(&self, trials: &LocalTrials) -> Option<u32> {
        match (self.network.served, trials) {
            (Served::Sensor(own), _) => Some(own.trials),
            (Served::Trials { min, max }, LocalTrials::Same(trials)) => {
                (min..=max).contains(trials).then_some(*trials)
            }
            _ => None,
        }
    }
}

/// Return the number of ones of each pixel.
fn count_ones(bits: &PackedBits<'_>, oversampling: usize) -> Result<Array2<i32>> {
    let mut counts = Array2::zeros(bits.pixel_shape(oversampling)?);
    add_block_counts(bits, oversampling, None, counts.view_mut())?;
    Ok(counts)
}

fn same_jots(jot: JotResponse) -> JotResponses<'static> {
    JotResponses {
        efficiency: Values::Same(jot.efficiency),
        dark_counts: Values::Same(jot.dark_counts),
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
