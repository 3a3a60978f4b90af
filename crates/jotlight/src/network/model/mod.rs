//! Networks as their files describe them, and the images that they reconstruct.
//!
//! [`Network`] holds layers whose parameters may depend on K. [`Network::prepare`] computes the
//! layers for one sensor, and [`Reconstruction`] runs them on bits or counts.

mod conditioning;
mod denoise;
#[cfg(feature = "safetensors")]
mod file;
mod levels;
mod reconstruction;
mod regions;

use std::sync::{Arc, Mutex};

use ndarray::{ArrayD, ArrayView2, Axis};

use super::graph::Graph;
use super::layer::{Layer, Wiring};
use crate::error::{Error, Result};
use crate::mle::{JotResponse, PixelResponse};

pub use reconstruction::Reconstruction;

/// The rate of a jot at the largest intensity above which networks estimate P(b = 0).
///
/// Near saturation, an `f32` holds only a few digits of 1 − P(b = 1), on which the intensity
/// depends.
const BRIGHT: f64 = 4.0;

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

/// The maximum number of K whose layers are kept, for films and maps of trials.
const MAX_KEPT: usize = 16;

/// Layers for one K, and the K. The boolean says whether they estimate P(b = 0).
type Kept = ((u32, bool), Arc<Vec<Layer<f32>>>);

/// What a network must know about a sensor, all of whose jots are alike.
#[derive(Clone, Copy, Debug)]
pub struct SensorModel {
    /// K, the number of bits of a pixel.
    pub trials: u32,
    /// The threshold, α/K, and S.
    pub response: PixelResponse,
    /// The quantum efficiency and the dark counts of the jots.
    pub jot: JotResponse,
}

impl SensorModel {
    /// Return η α/K: the expected detections of a jot per frame at intensity 1.
    fn detected_light(&self) -> f64 {
        self.jot.efficiency * self.response.light_per_intensity
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
}

/// A reconstruction network: linear filters and pointwise splines, equations (8) to (11).
#[derive(Clone, Debug)]
pub struct Network {
    layers: Vec<LayerParameters>,
    served: Served,
    halo: usize,
    kept: Arc<Mutex<Vec<Kept>>>,
}

impl Network {
    /// Return a network of layers, and check that they fit each other.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if the layers do not match, or if layers have
    /// different numbers of sets of parameters, or sets without a range of K.
    pub fn new(layers: Vec<LayerParameters>, served: Served) -> Result<Self> {
        let mut network = Self {
            layers,
            served,
            halo: 0,
            kept: Arc::default(),
        };
        let trials = match served {
            Served::Trials { min, max } if 1 <= min && min < max => min,
            Served::Trials { min, max } => {
                let expected = "1 or more for the smallest K, and more for the largest";
                let received = format!("{min} and {max}");
                return Err(Error::range("range of K", expected, received));
            }
            Served::Sensor(sensor) => sensor.trials,
        };
        let sets = network.sets()?;
        match (served, sets) {
            (Served::Sensor(_), Some(sets)) => {
                let expected = "layers without sets of parameters for a single K";
                return Err(Error::range("layers", expected, sets));
            }
            (Served::Trials { .. }, _) if !network.is_tied() => {
                let expected = "one weight for all bits of a pixel in a network for many K";
                return Err(Error::range("layers", expected, "several weights"));
            }
            _ => {}
        }
        let layers = network.layers_for(trials, false)?;
        let channels = layers.last().map_or(0, Layer::channels);
        if channels != 1 {
            let what = "output channels of the last layer";
            return Err(Error::shape(what, 1, channels));
        }
        network.halo = halo(&layers.iter().collect::<Vec<_>>())?;
        Ok(network)
    }

    /// Return whether the first layer has one weight for all bits of a pixel, and so takes counts.
    #[must_use]
    pub fn is_tied(&self) -> bool {
        let filters = self.layers.first().map(|layer| layer.filters.shape());
        filters.is_some_and(|shape| shape[shape.len() - 3..] == [1, 1, 1])
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

    /// Return the layers and what else is necessary for the data of a sensor.
    ///
    /// The layers for one K are computed only once, so one result serves all images of a film.
    ///
    /// # Errors
    /// [`Error::Range`] if the network does not serve the sensor.
    pub fn prepare(&self, sensor: SensorModel) -> Result<Reconstruction<'_>> {
        Reconstruction::new(self, sensor)
    }

    /// Return whether the network estimates P(b = 0) for a sensor, and not P(b = 1).
    fn estimates_zeros(&self, sensor: &SensorModel) -> bool {
        let rate = sensor.detected_light() * sensor.response.max_intensity + sensor.jot.dark_counts;
        let has_spline = self.layers.last().is_some_and(|x| x.coefficients.is_some());
        let is_conditional = matches!(self.served, Served::Trials { .. });
        is_conditional && has_spline && sensor.response.threshold.photons() == 1 && rate > BRIGHT
    }

    /// Return the layers for K = `trials`: those from counts to P(b = 1), or P(b = 0) if `zeros`.
    ///
    /// The layers of the last few K are kept. No call waits for another one: after a fork, a child
    /// process could wait forever.
    fn layers_for(&self, trials: u32, zeros: bool) -> Result<Arc<Vec<Layer<f32>>>> {
        let key = (trials, zeros);
        if let Ok(kept) = self.kept.try_lock()
            && let Some((_, layers)) = kept.iter().find(|(other, _)| *other == key)
        {
            return Ok(Arc::clone(layers));
        }
        let layers = Arc::new(self.compute_layers(trials, zeros)?);
        if let Ok(mut kept) = self.kept.try_lock() {
            if kept.len() == MAX_KEPT {
                kept.remove(0);
            }
            kept.push((key, Arc::clone(&layers)));
        }
        Ok(layers)
    }

    fn compute_layers(&self, trials: u32, zeros: bool) -> Result<Vec<Layer<f32>>> {
        let weights = match (self.served, self.sets()?) {
            (Served::Trials { min, max }, Some(sets)) => {
                conditioning::weights(trials, (min, max), sets)?
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
            conditioning::layer(layer, &weights, divisor, complement)
        });
        layers.collect()
    }

    /// Return the number of sets of parameters, if layers have sets.
    fn sets(&self) -> Result<Option<usize>> {
        let mut found = None;
        for layer in &self.layers {
            let filters = (layer.filters.ndim() == 5).then(|| layer.filters.len_of(Axis(0)));
            let coefficients = layer.coefficients.as_ref();
            let coefficients = coefficients.filter(|array| array.ndim() == 3);
            let coefficients = coefficients.map(|array| array.len_of(Axis(0)));
            for sets in filters.into_iter().chain(coefficients) {
                if sets < conditioning::MIN_SETS || found.is_some_and(|found| found != sets) {
                    let expected = "the same number of sets of parameters in all layers, 4 or more";
                    return Err(Error::range("layers", expected, sets));
                }
                found = Some(sets);
            }
        }
        Ok(found)
    }
}

/// Return the radius of the receptive field of layers, a multiple of the size divisor.
///
/// The tiles of the image are larger, because convolutions compute squares of pixels. A halo of
/// whole squares would not begin at a multiple of the size divisor.
fn halo(layers: &[&Layer<f32>]) -> Result<usize> {
    let graph = Graph::new(layers)?;
    let step = graph.size_divisor as isize;
    // The rows of each layer's output on which `step` rows of the image depend; same for columns.
    let mut needed: Vec<Option<(isize, isize)>> = vec![None; layers.len()];
    if let Some(last) = needed.last_mut() {
        *last = Some((0, step));
    }
    let include = |needed: &mut Vec<Option<(isize, isize)>>, layer: usize, part| {
        let (start, end): (isize, isize) = part;
        let (low, high) = needed[layer].unwrap_or(part);
        needed[layer] = Some((low.min(start), high.max(end)));
    };
    for (index, layer) in layers.iter().enumerate().skip(1).rev() {
        let Some((start, end)) = needed[index] else {
            continue;
        };
        let upsampling = layer.wiring.upsampling as isize;
        let first = start.div_euclid(upsampling);
        let last = -(-end).div_euclid(upsampling);
        let stride = layer.wiring.stride as isize;
        let (_, _, rows, columns) = layer.filters().dim();
        for taps in [rows as isize, columns as isize] {
            let padding = (taps - stride) / 2;
            let part = (first * stride, (last - 1) * stride + taps);
            let part = (part.0 - padding, part.1 - padding);
            include(&mut needed, graph.inputs[index], part);
        }
        if let Some(skip) = layer.wiring.skip {
            include(&mut needed, skip, (first * upsampling, last * upsampling));
        }
    }
    let (start, end) = needed.first().copied().flatten().unwrap_or((0, step));
    let radius = (-start).max(end - step).max(0).cast_unsigned();
    Ok(radius.next_multiple_of(graph.size_divisor))
}

/// Return whether all values of an array are the same, and the first one.
fn only_value(values: ArrayView2<'_, f64>) -> Option<f64> {
    let first = *values.first()?;
    let is_same = |value: &f64| value.total_cmp(&first).is_eq();
    values.iter().all(is_same).then_some(first)
}
