//! K-conditioned networks for pixels with different numbers of trials, and for more than they know.
//!
//! A K-conditioned network is for one K at a time. It runs at some levels of K, each of them where
//! pixels need it, and pixels between two levels are interpolated.
//!
//! Beyond the largest K of the network, the noise is weaker than it expects. The network then
//! removes details together with the noise. So the difference between the data and the estimate is
//! amplified, until its noise is that of the largest K, and the network denoises it again around
//! the estimate.

use std::collections::BTreeMap;
use std::f32::consts::FRAC_PI_2;

use ndarray::{Array2, ArrayView2, Zip};
use rayon::prelude::*;

use super::Network;
use super::levels::{check_map, level_weights};
use super::local_trials::LocalTrials;
use super::regions::{Band, cover};
use crate::error::{Error, Result};

/// The maximum ratio of K to that of the network for one more pass of the network.
pub const RATIO_OF_PASS: f64 = 16.0;

/// A region is widened by the halo of the network divided by this number. What lies farther away in
/// the receptive field hardly changes estimates, and the weights of a level tend to 0 at the border
/// of its region.
const HALO_DIVISOR: usize = 3;

/// The parts of some images at which the network runs for one level, and their weights.
struct Part<'a> {
    image: usize,
    /// The band and the weights of the pixels, or none for the whole image with the weight 1.
    band: Option<(&'a Band, &'a Array2<f32>)>,
}

/// Images with the same map of weights for a level, and the bands that contain their pixels.
type Level = (Vec<usize>, Option<(Array2<f32>, Vec<Band>)>);

/// A K-conditioned network from fractions of ones to P(b = 1), or of zeros to P(b = 0).
pub(super) struct Denoiser<'a> {
    pub network: &'a Network,
    pub zeros: bool,
    /// The smallest and the largest K of the network.
    pub range: (u32, u32),
}

impl Denoiser<'_> {
    /// Return the probability at each pixel of images with fractions of ones, or of zeros.
    pub fn denoise(
        &self,
        fractions: &[ArrayView2<'_, f32>],
        trials: &[LocalTrials],
    ) -> Result<Vec<Array2<f32>>> {
        check_trials(fractions, trials)?;
        let groups = group(trials);
        let served: Vec<_> = groups
            .iter()
            .map(|images| trials[images[0]].clamp(self.range))
            .collect();
        let runs = groups.iter().cloned().zip(&served);
        let mut estimates = self.at_levels(fractions, runs)?;
        let largest = self.range.1;
        let passes: Vec<_> = groups
            .iter()
            .map(|images| {
                let excess = (trials[images[0]].max() / f64::from(largest)).max(1.0);
                (excess.ln() / RATIO_OF_PASS.ln()).ceil() as usize
            })
            .collect();
        for pass in 0..passes.iter().copied().max().unwrap_or(0) {
            let mut raised = Vec::new();
            for (group, images) in groups.iter().enumerate() {
                for &image in images.iter().filter(|_| passes[group] > pass) {
                    let own = (&trials[image], &served[group]);
                    raised.push((
                        image,
                        group,
                        amplify(&estimates[image], fractions[image], own),
                    ));
                }
            }
            // Only pixels with more trials than the network serves change.
            let views: Vec<_> = raised.iter().map(|(.., image)| image.view()).collect();
            let all = (0..raised.len()).collect();
            let denoised = self.at_levels(&views, [(all, &LocalTrials::Same(largest))])?;
            for ((image, group, _), denoised) in raised.iter().zip(denoised) {
                let own = (&trials[*image], &served[*group]);
                add_change(&mut estimates[*image], &denoised, own);
            }
        }
        Ok(estimates)
    }

    /// Return the probabilities in [0, 1], interpolated between the levels of K.
    ///
    /// `groups` are the indices of images with the same trials, and these.
    fn at_levels<'t>(
        &self,
        fractions: &[ArrayView2<'_, f32>],
        groups: impl IntoIterator<Item = (Vec<usize>, &'t LocalTrials)>,
    ) -> Result<Vec<Array2<f32>>> {
        let halo = self.network.halo().div_ceil(HALO_DIVISOR);
        let mut levels: BTreeMap<u32, Vec<Level>> = BTreeMap::new();
        for (images, trials) in groups {
            match trials {
                LocalTrials::Same(level) => levels.entry(*level).or_default().push((images, None)),
                LocalTrials::Map(map) => {
                    for (level, weights) in level_weights(map.view())? {
                        let bands = cover(weights.view(), halo);
                        let part = (images.clone(), Some((weights, bands)));
                        levels.entry(level).or_default().push(part);
                    }
                }
            }
        }
        let zeros = fractions
            .iter()
            .map(|image| Array2::<f32>::zeros(image.dim()));
        let mut sums: Vec<_> = zeros.collect();
        // Levels for few pixels do not occupy all threads, so all levels run at the same time.
        let levels: Vec<_> = levels.into_iter().collect();
        let runs = levels.par_iter().map(|(level, groups)| {
            let parts: Vec<_> = groups.iter().flat_map(parts_of).collect();
            let counts = parts.iter().map(|part| {
                let ones = |fraction: f32| {
                    let ones = if self.zeros { 1.0 - fraction } else { fraction };
                    ones * *level as f32
                };
                match part.band {
                    None => fractions[part.image].mapv(ones),
                    Some((band, _)) => band.cut(fractions[part.image], ones),
                }
            });
            let outputs = self
                .network
                .run_counts(counts.collect(), *level, self.zeros)?;
            Ok((parts, outputs))
        });
        for (parts, outputs) in runs.collect::<Result<Vec<_>>>()? {
            for (part, output) in parts.iter().zip(outputs) {
                let sum = &mut sums[part.image];
                match part.band {
                    None => *sum += &output,
                    Some((band, weights)) => {
                        band.add(output.view(), weights.view(), sum.view_mut());
                    }
                }
            }
        }
        for sum in &mut sums {
            sum.mapv_inplace(|p| p.clamp(0.0, 1.0));
        }
        Ok(sums)
    }
}

/// Return the parts of images at which the network runs for a level.
fn parts_of((images, weights): &Level) -> Vec<Part<'_>> {
    let bands = |&image: &usize| match weights {
        None => vec![Part { image, band: None }],
        Some((weights, bands)) => {
            let part = |band| Part {
                image,
                band: Some((band, weights)),
            };
            bands.iter().map(part).collect()
        }
    };
    images.iter().flat_map(bands).collect()
}

/// Check that each image has trials, and that their maps have its size.
fn check_trials(images: &[ArrayView2<'_, f32>], trials: &[LocalTrials]) -> Result<()> {
    if images.len() != trials.len() {
        return Err(Error::shape("trials", images.len(), trials.len()));
    }
    for (image, trials) in images.iter().zip(trials) {
        if let LocalTrials::Same(0) = trials {
            return Err(Error::range("trials", "numbers above 0", 0));
        }
        if image.is_empty() {
            return Err(Error::range("image", "at least one pixel", "none"));
        }
        trials.check_shape(image.dim())?;
        if let LocalTrials::Map(map) = trials {
            check_map(map.view())?;
        }
    }
    Ok(())
}

/// Return the indices of images with the same number of trials, or with the same map.
fn group(trials: &[LocalTrials]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (image, own) in trials.iter().enumerate() {
        let is_same = |images: &&mut Vec<usize>| match (&trials[images[0]], own) {
            (LocalTrials::Same(one), LocalTrials::Same(other)) => one == other,
            // Images of the same sensor share one map.
            (LocalTrials::Map(one), LocalTrials::Map(other)) => {
                let layouts = [one, other].map(|map| (map.as_ptr(), map.dim(), map.strides()));
                layouts[0] == layouts[1]
            }
            _ => false,
        };
        match groups.iter_mut().find(is_same) {
            Some(images) => images.push(image),
            None => groups.push(vec![image]),
        }
    }
    groups
}

/// Return fractions whose difference to an estimate is amplified, so that its noise is that of the
/// served trials.
fn amplify(
    estimate: &Array2<f32>,
    fractions: ArrayView2<'_, f32>,
    (own, served): (&LocalTrials, &LocalTrials),
) -> Array2<f32> {
    let mut raised = Array2::zeros(estimate.dim());
    let (own, served) = (own.to_array(), served.to_array());
    Zip::from(&mut raised)
        .and(estimate)
        .and(fractions)
        .and_broadcast(&own)
        .and_broadcast(&served)
        .par_for_each(|raised, &estimate, &fraction, &own, &served| {
            let base = estimate.sqrt().asin();
            let data = stabilize(fraction, own);
            let angle = base + (own / served).sqrt() * (data - base);
            *raised = fraction_of(angle.clamp(0.0, FRAC_PI_2), served);
        });
    raised
}

/// Change an estimate to the denoised result of [`amplify`], whose difference becomes smaller again.
fn add_change(
    estimate: &mut Array2<f32>,
    denoised: &Array2<f32>,
    (own, served): (&LocalTrials, &LocalTrials),
) {
    let (own, served) = (own.to_array(), served.to_array());
    Zip::from(estimate)
        .and(denoised)
        .and_broadcast(&own)
        .and_broadcast(&served)
        .par_for_each(|estimate, &denoised, &own, &served| {
            let gain = (own / served).sqrt();
            if gain > 1.0 {
                let base = estimate.sqrt().asin();
                let angle = base + (denoised.sqrt().asin() - base) / gain;
                *estimate = angle.clamp(0.0, FRAC_PI_2).sin().powi(2);
            }
        });
}

/// Return the angle arcsin √((L + ⅜)/(K + ¾)) of a fraction L/K, whose noise has the variance 1/(4K).
///
/// It is T(L) of equation (6) without its factor √(K + ½), see [`crate::vst::transform`].
fn stabilize(fraction: f32, trials: f32) -> f32 {
    ((fraction * trials + 0.375) / (trials + 0.75))
        .sqrt()
        .asin()
}

/// Return the inverse of [`stabilize`]: T⁻¹ of equation (7), divided by K, for this angle.
fn fraction_of(angle: f32, trials: f32) -> f32 {
    (angle.sin().powi(2) * (trials + 0.75) - 0.375) / trials
}

#[cfg(test)]
mod tests {
    use ndarray::s;

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

    #[test]
    fn images_with_the_same_map_form_a_group() {
        let map = || Array2::<f32>::ones((2, 2)).into_shared();
        let (one, other) = (map(), map());
        let part = one.clone().slice_move(s![..1, ..]);
        let trials = [
            LocalTrials::Map(one.clone()),
            LocalTrials::Same(3),
            LocalTrials::Map(other.clone()),
            LocalTrials::Same(3),
            LocalTrials::Map(one.clone()),
            LocalTrials::Same(4),
            LocalTrials::Map(part),
        ];
        let expected = [vec![0, 4], vec![1, 3], vec![2], vec![5], vec![6]];
        assert_eq!(group(&trials), expected);
    }
}
