//! The layers of a network for one K and precision, which are kept for the next image.

use std::sync::Arc;

use super::{LayerParameters, Network};
use crate::error::{Error, Result};
use crate::network::layer::Layer;
use crate::network::precision::{Precision, Rounding, roundings};

/// The maximum number of K whose layers are kept, for films and maps of trials.
const MAX_KEPT: usize = 16;

/// Layers for one K and precision. The boolean says whether they estimate P(b = 0).
pub(super) type Kept = ((f64, bool, Precision), Arc<Vec<Layer<f32>>>);

impl Network {
    /// Return the network with its products in another precision.
    ///
    /// In bfloat16, layers that read several planes of a layer other than the first one round
    /// their filters and these planes. Sums, splines, and all other values remain `f32`. The
    /// networks share their parameters.
    ///
    /// # Errors
    /// [`Error::Range`] for bfloat16 if there is no such layer, as in the network of two layers.
    pub fn with_precision(mut self, precision: Precision) -> Result<Self> {
        self.precision = precision;
        if precision == Precision::Bf16 && !self.roundings().iter().any(|each| each.filters) {
            let expected = "f32, because no layer of this network reads several filtered planes";
            return Err(Error::range("precision", expected, "bf16"));
        }
        Ok(self)
    }

    /// Return what each layer rounds.
    fn roundings(&self) -> Vec<Rounding> {
        if self.precision == Precision::F32 {
            return vec![Rounding::default(); self.layers.len()];
        }
        let inputs = self.layers.iter().enumerate().map(|(index, layer)| {
            let planes = layer.filters.shape().iter().rev().nth(2).copied();
            let input = layer.wiring.input.unwrap_or(index.saturating_sub(1));
            (planes.unwrap_or(1), input)
        });
        roundings(&inputs.collect::<Vec<_>>())
    }

    /// Return the layers of [`Network::conditioned`] in the precision of the network.
    ///
    /// Those of the last few K are kept. No call waits for another one: after a fork, a child
    /// process could wait forever.
    pub(super) fn layers_for(&self, trials: f64, zeros: bool) -> Result<Arc<Vec<Layer<f32>>>> {
        let key = (trials, zeros, self.precision);
        if let Ok(kept) = self.kept.try_lock()
            && let Some((_, layers)) = kept.iter().find(|(other, _)| *other == key)
        {
            return Ok(Arc::clone(layers));
        }
        let parameters = self.conditioned(trials, zeros)?.into_iter();
        let layers = parameters.map(LayerParameters::into_layer);
        let layers = layers.zip(self.roundings());
        let layers = layers.map(|(layer, rounding)| Ok(layer?.rounded(rounding)));
        let layers = Arc::new(layers.collect::<Result<Vec<_>>>()?);
        if let Ok(mut kept) = self.kept.try_lock() {
            if kept.len() == MAX_KEPT {
                kept.remove(0);
            }
            kept.push((key, Arc::clone(&layers)));
        }
        Ok(layers)
    }
}
