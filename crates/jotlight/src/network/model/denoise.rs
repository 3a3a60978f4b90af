//! K-conditioned networks for pixels with different numbers of trials, and for more than they know.
//!
//! A K-conditioned network is for one K at a time. It runs at some levels of K, each of them where
//! pixels need it, and pixels between two levels are interpolated.
//!
//! Beyond the largest K of the network, the noise is weaker than it expects. The network then
//! removes details together with the noise. So the difference between the data and the estimate is
//! amplified, until its noise is that of the largest K, and the network denoises it again around
//! the estimate.

use std::f32::consts::FRAC_PI_2;

use ndarray::{Array2, ArrayView2, Zip, s};

use super::Network;
use super::levels::{LocalTrials, level_weights};
use super::regions::{cover, widen};
use crate::error::Result;
use crate::network::forward;
use crate::network::layer::Layer;
use crate::network::tiling::region::Region;

/// The maximum ratio of K to that of the network for one more pass of the network.
const RATIO_OF_PASS: f64 = 16.0;

/// A region is widened by the halo of the network divided by this number. The outer half of the
/// receptive field changes estimates by 1e-5 of the intensity, and the weights of a level tend to 0
/// at the border of its region.
const SHARE_OF_HALO: usize = 2;

/// A K-conditioned network from fractions of ones to P(b = 1), or of zeros to P(b = 0).
pub(super) struct Denoiser<'a> {
    pub network: &'a Network,
    pub zeros: bool,
    /// The smallest and the largest K of the network.
    pub range: (u32, u32),
}

impl Denoiser<'_> {
    /// Return the probability at each pixel from fractions of ones, or of zeros.
    pub fn denoise(
        &self,
        fractions: ArrayView2<'_, f32>,
        trials: &LocalTrials,
    ) -> Result<Array2<f32>> {
        let (smallest, largest) = self.range;
        let served = match trials {
            LocalTrials::Same(trials) => LocalTrials::Same((*trials).clamp(smallest, largest)),
            LocalTrials::Map(map) => {
                LocalTrials::Map(map.mapv(|n| n.clamp(smallest as f32, largest as f32)))
            }
        };
        let mut estimate = self.at_levels(fractions, &served)?;
        let (own, served) = (as_map(trials), as_map(&served));
        let most = own.iter().fold(0.0f32, |most, &n| most.max(n));
        let excess = (f64::from(most) / f64::from(largest)).max(1.0);
        let passes = (excess.ln() / RATIO_OF_PASS.ln()).ceil() as usize;
        let shape = fractions.dim();
        let [own, served] = [&own, &served].map(|map| map.broadcast(shape));
        let (Some(own), Some(served)) = (own, served) else {
            return Ok(estimate);
        };
        for _ in 0..passes {
            let base = estimate.mapv(|p| p.sqrt().asin());
            let mut raised = Array2::zeros(shape);
            Zip::from(&mut raised)
                .and(&base)
                .and(fractions)
                .and(own)
                .and(served)
                .for_each(|raised, &base, &fraction, &own, &served| {
                    let data = stabilize(fraction, own);
                    let angle = base + (own / served).sqrt() * (data - base);
                    *raised = fraction_of(angle.clamp(0.0, FRAC_PI_2), served);
                });
            // Only pixels with more trials than the network serves change.
            let denoised = self.at_levels(raised.view(), &LocalTrials::Same(largest))?;
            Zip::from(&mut estimate)
                .and(&base)
                .and(&denoised)
                .and(own)
                .and(served)
                .for_each(|estimate, &base, &denoised, &own, &served| {
                    let gain = (own / served).sqrt();
                    if gain > 1.0 {
                        let angle = base + (denoised.sqrt().asin() - base) / gain;
                        *estimate = angle.clamp(0.0, FRAC_PI_2).sin().powi(2);
                    }
                });
        }
        Ok(estimate)
    }

    /// Return the probabilities in [0, 1], interpolated between the levels of K.
    fn at_levels(
        &self,
        fractions: ArrayView2<'_, f32>,
        trials: &LocalTrials,
    ) -> Result<Array2<f32>> {
        let size = fractions.dim();
        let halo = self.network.halo().div_ceil(SHARE_OF_HALO);
        let mut result = Array2::<f32>::zeros(size);
        let levels = match trials {
            LocalTrials::Same(level) => vec![(*level, Array2::ones(size))],
            LocalTrials::Map(map) => level_weights(map.view()),
        };
        for (level, weights) in levels {
            let layers = self.network.layers_for(level, self.zeros)?;
            for region in cover(weights.view(), halo) {
                let wide = widen(&region, halo, size);
                let input = fractions.slice(s![wide.rows.clone(), wide.columns.clone()]);
                let output = self.run(&layers, input, level)?;
                let (top, left) = (wide.rows.start, wide.columns.start);
                let Region { rows, columns } = region;
                let inner = output.slice(s![
                    rows.start - top..rows.end - top,
                    columns.start - left..columns.end - left
                ]);
                let place = result.slice_mut(s![rows.clone(), columns.clone()]);
                Zip::from(place)
                    .and(weights.slice(s![rows, columns]))
                    .and(inner)
                    .for_each(|result, &weight, &value| *result += weight * value);
            }
        }
        result.mapv_inplace(|p| p.clamp(0.0, 1.0));
        Ok(result)
    }

    /// Return the output of the layers for K = `level`.
    fn run(
        &self,
        layers: &[Layer<f32>],
        fractions: ArrayView2<'_, f32>,
        level: u32,
    ) -> Result<Array2<f32>> {
        let level = level as f32;
        let ones = |fraction: f32| if self.zeros { 1.0 - fraction } else { fraction };
        let counts = fractions.mapv(|fraction| ones(fraction) * level);
        run_counts(layers, counts.view())
    }
}

/// Return the output of tied layers for counts, which need not be whole.
pub(super) fn run_counts(
    layers: &[Layer<f32>],
    counts: ArrayView2<'_, f32>,
) -> Result<Array2<f32>> {
    let weights: Vec<f32> = tied_weights(layers);
    let (height, width) = counts.dim();
    let sums = ndarray::Array3::from_shape_fn((weights.len(), height, width), |(plane, y, x)| {
        weights[plane] * counts[[y, x]]
    });
    let mut out = Array2::zeros((height, width));
    let layers: Vec<_> = layers.iter().collect();
    forward::forward(&layers, sums.view(), out.view_mut())?;
    Ok(out)
}

/// Return the weight of each channel of a tied first layer.
pub(super) fn tied_weights(layers: &[Layer<f32>]) -> Vec<f32> {
    let first = layers.first().map(|layer| layer.filters().to_owned());
    first.map_or_else(Vec::new, |filters| filters.into_iter().collect())
}

/// Return trials as an array that broadcasts with an image.
fn as_map(trials: &LocalTrials) -> Array2<f32> {
    match trials {
        LocalTrials::Same(trials) => Array2::from_elem((1, 1), *trials as f32),
        LocalTrials::Map(map) => map.clone(),
    }
}

/// Return the angle whose noise is 1/(4K): arcsin √((L + ⅜)/(K + ¾)).
fn stabilize(fraction: f32, trials: f32) -> f32 {
    ((fraction * trials + 0.375) / (trials + 0.75))
        .sqrt()
        .asin()
}

/// Return the inverse of [`stabilize`].
fn fraction_of(angle: f32, trials: f32) -> f32 {
    (angle.sin().powi(2) * (trials + 0.75) - 0.375) / trials
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_are_restored_from_their_angles() {
        for trials in [1.0f32, 7.5, 256.0] {
            for step in 0..=20u8 {
                let fraction = f32::from(step) / 20.0;
                let restored = fraction_of(stabilize(fraction, trials), trials);
                assert!((restored - fraction).abs() < 2e-6);
            }
        }
    }
}
