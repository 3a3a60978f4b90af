//! The reconstruction of counts whose pixels may differ, by the counts that equal jots would show.

use std::collections::BTreeMap;

use ndarray::{Array2, ArrayView2, ArrayViewMut2};

use super::Served;
use super::evaluate::tied_weights;
use super::local_trials::{LocalTrials, local_trials};
use super::pixels::{EquivalentCounts, Pixels};
use super::reconstruction::Reconstruction;
use crate::error::{Error, Result};
use crate::mle;
use crate::network::images::write_images;
use crate::network::layer::Layer;
use crate::values::Values;

impl Reconstruction<'_> {
    /// Write the images of counts that equal jots would show into `out`.
    ///
    /// Images of few photons are not corrected by squares of their pixels, as those of
    /// [`Self::pixels`] are.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes do not match, or the rows of an image of `out` are not
    /// contiguous. [`Error::Range`] for counts that are not finite or below 0, trials that are not
    /// above 0, different trials for networks for one K, and networks that weigh each jot of a pixel.
    pub fn equivalent_counts(
        &self,
        images: &[EquivalentCounts<'_>],
        mut out: Vec<ArrayViewMut2<'_, f32>>,
    ) -> Result<()> {
        if images.len() != out.len() {
            return Err(Error::shape("out", images.len(), out.len()));
        }
        for (image, out) in images.iter().zip(&out) {
            image.check(out)?;
        }
        let mut levels: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        let mut others = Vec::new();
        for (place, image) in images.iter().enumerate() {
            match self.level(&image.trials) {
                Some(level) => levels.entry(level).or_default().push(place),
                None => others.push(place),
            }
        }
        for (level, places) in levels {
            let layers = self.network.layers_for(f64::from(level), self.zeros)?;
            let inputs = places.iter().map(|&place| images[place].counts_of(level));
            let own = out.iter_mut().enumerate();
            let own = own.filter(|(place, _)| places.contains(place));
            let own = own.map(|(_, image)| image.view_mut()).collect();
            write_images(inputs.collect(), own, |counts, out| {
                self.network.write_counts(&layers, counts.view(), out)
            })?;
        }
        if !others.is_empty() {
            let fractions: Vec<_> = others
                .iter()
                .map(|&place| {
                    let ones = images[place].counts_of(1);
                    if self.zeros {
                        ones.mapv(|ones| 1.0 - ones).into()
                    } else {
                        ones
                    }
                })
                .collect();
            let fractions: Vec<_> = fractions.iter().map(|image| image.view()).collect();
            let trials = others.iter().map(|&place| images[place].trials.clone());
            let trials: Vec<_> = trials.collect();
            let found = self.network.denoise(&fractions, &trials, self.zeros)?;
            for (&place, found) in others.iter().zip(found) {
                out[place].assign(&found);
            }
        }
        out.iter_mut()
            .try_for_each(|out| self.to_intensities(out.view_mut()))?;
        write_images(images.iter().collect(), out, |image, out| {
            self.correct_dark(out, &image.trials, || Ok(image.counts_of(1).into_owned()))
        })
    }

    /// Return the local trials of pixels.
    pub(super) fn local_trials_of(&self, pixels: &Pixels<'_>) -> Result<LocalTrials> {
        match pixels.trials {
            Values::Same(trials) => local_trials(ArrayView2::from(&[[trials]])),
            Values::Each(trials) => {
                if let Served::Sensor(_) = self.network.served {
                    let expected = "a network for many K";
                    return Err(Error::range("network", expected, "one for a single K"));
                }
                let map = ArrayView2::from_shape(pixels.counts.dim(), trials);
                let shape = pixels.counts.dim();
                local_trials(map.map_err(|_| Error::shape("trials", shape, trials.len()))?)
            }
        }
    }

    /// Return the sum p of the first layer for each count of pixels alike, `(C, K + 1)`.
    pub(super) fn table(
        &self,
        layers: &[Layer<f32>],
        pixels: &Pixels<'_>,
        of: u32,
    ) -> Result<Array2<f32>> {
        let Values::Same(trials) = pixels.trials else {
            return Err(Error::range("trials", "one number", "a map"));
        };
        let counts = Array2::from_shape_fn((1, trials as usize + 1), |(_, count)| count as i32);
        let all = Pixels {
            counts: counts.view(),
            ..*pixels
        };
        let counts = self.equivalent(&all, of)?;
        let weights = tied_weights(layers);
        let shape = (weights.len(), counts.ncols());
        Ok(Array2::from_shape_fn(shape, |(channel, count)| {
            weights[channel] * counts[[0, count]]
        }))
    }

    /// Return the counts among `of` bits that the jots for which the layers were made would show.
    pub(super) fn equivalent(&self, pixels: &Pixels<'_>, of: u32) -> Result<Array2<f32>> {
        let mut reference = self.sensor.jot;
        if let Served::Sensor(own) = self.network.served {
            // The check has established that both sensors detect equal light at intensity 1.
            reference.dark_counts = own.jot.dark_counts;
        }
        let counts = pixels.counts.as_standard_layout();
        let mut out = Array2::zeros(counts.dim());
        mle::equivalent_counts(
            &self.sensor.response,
            counts.as_slice().unwrap_or_default(),
            pixels.trials,
            &pixels.jots,
            &[f64::from(of)],
            reference,
            out.as_slice_mut().unwrap_or_default(),
        )?;
        Ok(out)
    }
}
