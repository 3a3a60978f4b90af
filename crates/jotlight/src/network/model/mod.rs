//! Networks as their files describe them, and the images that they reconstruct.
//!
//! [`Network`] holds layers whose parameters may depend on K. [`Network::prepare`] computes the
//! layers for one sensor, and [`Reconstruction`] runs them on bits or counts.

mod bounds;
mod coarse_scales;
mod conditioning;
mod corrections;
mod dark_regions;
mod denoise;
mod dim_scenes;
mod enlarge;
mod equivalent;
mod evaluate;
#[cfg(feature = "safetensors")]
mod file;
mod intensities;
mod kept_layers;
mod levels;
mod local_trials;
mod pixels;
mod receptive_field;
mod reconstruction;
mod regions;
mod rotations;
mod sensor_model;
mod squares;

use std::sync::{Arc, Mutex};

use ndarray::{ArrayD, Axis, Ix2, Ix4};

use super::graph::Graph;
use super::layer::{Layer, Wiring};
use super::precision::Precision;
use crate::error::{Error, Result};

pub use coarse_scales::add_coarse;
pub use conditioning::conditioning_weights;
pub use dark_regions::match_dark_regions;
pub use denoise::RATIO_OF_PASS;
pub use dim_scenes::{Combined, trials_per_combined};
pub use levels::level_weights;
pub use local_trials::{LocalTrials, local_trials};
pub use pixels::{EquivalentCounts, Pixels};
pub use reconstruction::Reconstruction;
pub use sensor_model::SensorModel;
pub use squares::{OfSquares, Squares};

/// The rate of a jot at the largest intensity above which networks estimate P(b = 0).
///
/// Near saturation, an `f32` holds only a few digits of 1 − P(b = 1), on which the intensity
/// depends. Below this rate, 1 − P(b = 1) exceeds 0.018 and has five digits. Above, the rounding
/// error of P(b = 0) near 1 changes no intensity by more than 1.5e-8 of the largest one.
pub const BRIGHT: f64 = 4.0;

/// The parameters of a layer of a [`Network`].
#[derive(Clone, Debug)]
pub struct LayerParameters {
    /// The filters `(C, C_in, height, width)`, or M sets of them, `(M, C, C_in, height, width)`.
    pub filters: ArrayD<f32>,
    /// The spline coefficients `(channels, N_w)`, or M sets of them, or none for a linear layer.
    pub coefficients: Option<ArrayD<f32>>,
    /// The first knot of the splines.
    pub start: f64,
    /// The distance between knots.
    pub spacing: f64,
    /// The connections to other layers.
    pub wiring: Wiring,
}

impl LayerParameters {
    /// Return the layer, if it has a single set of parameters.
    fn into_layer(self) -> Result<Layer<f32>> {
        let shape = self.filters.shape().to_vec();
        let filters = self.filters.into_dimensionality::<Ix4>();
        let filters =
            filters.map_err(|_| Error::shape("filters", format_args!("4 dimensions"), shape))?;
        let coefficients = match self.coefficients {
            None => None,
            Some(coefficients) => {
                let shape = coefficients.shape().to_vec();
                let coefficients = coefficients.into_dimensionality::<Ix2>();
                let expected = format_args!("2 dimensions");
                let wrong = |_| Error::shape("coefficients", expected, shape);
                Some(coefficients.map_err(wrong)?)
            }
        };
        Layer::new(
            filters,
            coefficients.as_ref().map(|array| array.view()),
            self.start as f32,
            self.spacing as f32,
            self.wiring,
        )
    }
}

/// The sensors that a network serves.
#[derive(Clone, Copy, Debug)]
pub enum Served {
    /// Every sensor with at least `min` bits per pixel. Up to `max`, the parameters depend on K.
    Trials {
        /// The smallest K.
        min: u32,
        /// The largest K for which the network has parameters.
        max: u32,
    },
    /// Sensors with the number of bits, the threshold, the detected light, and S of this one.
    Sensor(SensorModel),
    /// Planes of estimates of every sensor, from −π/2 to π/2, which the network improves. From `min`
    /// to `max` bits per pixel, the parameters depend on K. There may be several outputs.
    Planes {
        /// The smallest K for which the network has parameters.
        min: u32,
        /// The largest one.
        max: u32,
    },
}

impl Served {
    /// Return the smallest and the largest K, if the parameters may depend on K.
    fn range(&self) -> Option<(u32, u32)> {
        match *self {
            Self::Trials { min, max } | Self::Planes { min, max } => Some((min, max)),
            Self::Sensor(_) => None,
        }
    }
}

/// A reconstruction network: linear filters and pointwise splines, equations (8) to (11).
#[derive(Clone, Debug)]
pub struct Network {
    layers: Arc<Vec<LayerParameters>>,
    served: Served,
    rotations: usize,
    precision: Precision,
    halo: usize,
    size_divisor: usize,
    /// The smallest and the largest value that the last layer may have.
    output_bounds: Option<bounds::Interval>,
    kept: Arc<Mutex<Vec<kept_layers::Kept>>>,
}

impl Network {
    /// Return a network of layers, and check that they fit each other.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if the layers do not match, if layers have different
    /// numbers of sets of parameters, or sets without a range of K, if a parameter of the sensor is
    /// out of range, or if data exist for which a value in the network could overflow.
    pub fn new(layers: Vec<LayerParameters>, served: Served) -> Result<Self> {
        let mut network = Self {
            layers: Arc::new(layers),
            served,
            rotations: 1,
            precision: Precision::F32,
            halo: 0,
            size_divisor: 1,
            output_bounds: None,
            kept: Arc::default(),
        };
        if network.layers.is_empty() {
            return Err(Error::range("layers", "at least 1", 0));
        }
        if let Served::Sensor(sensor) = served {
            sensor.check()?;
        }
        let sets = network.sets()?;
        match (served, served.range()) {
            (_, Some((min, max))) if min < 1 || min >= max => {
                let expected = "1 or more for the smallest K, and more for the largest";
                let received = format!("{min} and {max}");
                return Err(Error::range("range of K", expected, received));
            }
            (Served::Sensor(_), _) if sets.is_some() => {
                let expected = "layers without sets of parameters for a single K";
                return Err(Error::range("layers", expected, sets.unwrap_or(0)));
            }
            (_, Some(_)) if !network.is_tied() => {
                let expected = "one weight for all bits of a pixel in a network for many K";
                return Err(Error::range("layers", expected, "several weights"));
            }
            _ => {}
        }
        let (trials, outputs, max_input) = match served {
            Served::Sensor(sensor) if network.is_tied() => {
                (sensor.trials, Some(1), sensor.trials.into())
            }
            Served::Sensor(sensor) => (sensor.trials, Some(1), 1.0),
            // The counts are divided by K.
            Served::Trials { min, .. } => (min, Some(1), 1.0),
            Served::Planes { min, .. } => (min, None, std::f64::consts::FRAC_PI_2),
        };
        network.output_bounds = bounds::output_bounds(&network.layers, max_input)?.pop();
        let mut layers = Vec::new();
        for parameters in network.conditioned(f64::from(trials), false)? {
            layers.push(parameters.into_layer()?);
        }
        let layers: Vec<_> = layers.iter().collect();
        network.size_divisor = Graph::new(&layers)?.size_divisor;
        network.halo = receptive_field::radius(&layers)?;
        let channels = layers.last().map_or(0, |last| last.channels());
        if let Some(outputs) = outputs.filter(|&outputs| outputs != channels) {
            let what = "output channels of the last layer";
            return Err(Error::shape(what, outputs, channels));
        }
        Ok(network)
    }

    /// Return the network with the mean of its outputs over 1 to 4 rotations of the data by 90
    /// degrees. This takes as many times as long, and the estimate is slightly better.
    ///
    /// # Errors
    /// [`Error::Range`] for another number, and for rotations of a network that weighs the jots of a
    /// pixel by their places.
    pub fn with_rotations(mut self, rotations: usize) -> Result<Self> {
        let max = if self.is_tied() { 4 } else { 1 };
        if !(1..=max).contains(&rotations) {
            let expected = format!("1 to {max}");
            return Err(Error::range("rotations", expected, rotations));
        }
        self.rotations = rotations;
        Ok(self)
    }

    /// Return whether the first layer has one weight for all bits of a pixel, and so takes counts.
    #[must_use]
    pub fn is_tied(&self) -> bool {
        let filters = self.layers.first().map(|layer| layer.filters.shape());
        filters.is_some_and(|shape| shape.len() >= 3 && shape[shape.len() - 3..] == [1, 1, 1])
    }

    /// Return the radius of the receptive field in pixels.
    #[must_use]
    pub fn halo(&self) -> usize {
        self.halo
    }

    /// Return the sensors that the network serves.
    #[must_use]
    pub fn served(&self) -> Served {
        self.served
    }

    /// Return what is necessary for the data of a sensor.
    ///
    /// The layers for one K are computed only once, so one network serves all images of a film.
    ///
    /// # Errors
    /// [`Error::Range`] if the network does not serve the sensor, or if the light, the largest
    /// intensity, the efficiency, or the dark counts are infinite, NaN, or negative.
    pub fn prepare(&self, sensor: SensorModel) -> Result<Reconstruction<'_>> {
        Reconstruction::new(self, sensor)
    }

    /// Return whether the network estimates P(b = 0) for a sensor, and not P(b = 1).
    ///
    /// It does for sensors with the threshold 1 that are bright. For q > 1, rounding errors of
    /// P(b = 0) near 1 would change dark pixels.
    #[must_use]
    pub fn estimates_zeros(&self, sensor: &SensorModel) -> bool {
        let rate = sensor.detected_light() * sensor.response.max_intensity + sensor.jot.dark_counts;
        let has_spline = self.layers.last().is_some_and(|x| x.coefficients.is_some());
        let is_conditional = matches!(self.served, Served::Trials { .. });
        is_conditional && has_spline && sensor.response.threshold.photons() == 1 && rate > BRIGHT
    }

    /// Return the parameters of the layers for K = `trials`. Those of a network for one sensor do
    /// not depend on it.
    ///
    /// The layers lead from counts to P(b = 1), or to P(b = 0) if `zeros`. Those of a color network
    /// lead from planes to P(b = 1).
    ///
    /// # Errors
    /// [`Error::Range`] for a K outside of the range of the network.
    pub fn conditioned(&self, trials: f64, zeros: bool) -> Result<Vec<LayerParameters>> {
        let weights = match (self.served.range(), self.sets()?) {
            (Some((min, max)), sets) => {
                let sets = sets.unwrap_or(conditioning::MIN_SETS);
                conditioning_weights(trials, (min.into(), max.into()), sets)?
            }
            _ => Vec::new(),
        };
        let last = self.layers.len().saturating_sub(1);
        let layers = self.layers.iter().enumerate().map(|(index, layer)| {
            let complement = zeros && index == last;
            let divisor = match self.served {
                Served::Trials { .. } if index == 0 => trials as f32,
                _ => 1.0,
            };
            conditioning::interpolate_layer(layer, &weights, divisor, complement)
        });
        layers.collect()
    }

    /// Return the number of sets of parameters, if layers have sets.
    fn sets(&self) -> Result<Option<usize>> {
        let mut found = None;
        for layer in self.layers.iter() {
            let filters = (layer.filters.ndim() == 5).then(|| layer.filters.len_of(Axis(0)));
            let coefficients = layer.coefficients.as_ref();
            let coefficients = coefficients.filter(|array| array.ndim() == 3);
            let coefficients = coefficients.map(|array| array.len_of(Axis(0)));
            for sets in filters.into_iter().chain(coefficients) {
                if sets < conditioning::MIN_SETS || found.is_some_and(|found| found != sets) {
                    let expected = "the same number of parameter sets in all layers, 4 or more";
                    return Err(Error::range("layers", expected, sets));
                }
                found = Some(sets);
            }
        }
        Ok(found)
    }
}
