//! Corrections of the images of dim scenes, of dark regions, and of few photons.

use ndarray::{Array2, ArrayView2, ArrayViewMut2, Zip};

use super::Served;
use super::dark_regions::match_dark_regions;
use super::dim_scenes::Combined;
use super::local_trials::LocalTrials;
use super::pixels::Pixels;
use super::reconstruction::Reconstruction;
use crate::error::{Error, Result};
use crate::mle;

impl Reconstruction<'_> {
    /// Correct the image of pixels with local trials.
    pub(super) fn correct(
        &self,
        mut image: ArrayViewMut2<'_, f32>,
        pixels: &Pixels<'_>,
        trials: &LocalTrials,
    ) -> Result<()> {
        self.correct_dark(image.view_mut(), trials, || self.equivalent(pixels, 1))?;
        self.add_squares(image, pixels)
    }

    /// Return whether [`Self::correct`] may change an image with the trials of the sensor.
    pub(super) fn may_need_correction(&self, image: ArrayView2<'_, f32>) -> bool {
        let trials = self.sensor.trials;
        self.may_be_dark(image, &LocalTrials::Same(trials))
            || self.has_few_photons(image, f64::from(trials))
    }

    /// Return whether [`Self::correct_dark`] may change an image.
    fn may_be_dark(&self, image: ArrayView2<'_, f32>, trials: &LocalTrials) -> bool {
        let is_conditional = matches!(self.network.served, Served::Trials { .. });
        is_conditional
            && (self.sensor.may_be_dim(image, trials.max())
                || self.sensor.may_have_dark_regions(image))
    }

    /// Replace the intensities of a dim scene by those of combined trials. In another scene, correct
    /// those of dark regions.
    ///
    /// `fractions` returns the fractions of ones, and is called for dark images only.
    pub(super) fn correct_dark(
        &self,
        mut image: ArrayViewMut2<'_, f32>,
        trials: &LocalTrials,
        fractions: impl FnOnce() -> Result<Array2<f32>>,
    ) -> Result<()> {
        let Served::Trials { min, .. } = self.network.served else {
            return Ok(());
        };
        if !self.may_be_dark(image.view(), trials) {
            return Ok(());
        }
        let fractions = fractions()?;
        let threshold = self.sensor.response.threshold;
        let (probabilities, weights) =
            if let Some(combined) = Combined::of(fractions.view(), trials, min)? {
                let (own, trials) = (combined.fractions.view(), &combined.trials);
                let number = std::slice::from_ref(trials);
                let mut found = self.network.denoise(&[own], number, false)?;
                let found = found.swap_remove(0);
                let matched = match_dark_regions(found.view(), own, trials, threshold)?;
                (matched / combined.factor, combined.weights(found.view())?)
            } else if self.sensor.may_have_dark_regions(image.view()) {
                let p = |&c: &f32| self.sensor.detection_probability(f64::from(c)) as f32;
                let p = Zip::from(&image).par_map_collect(p);
                let matched = match_dark_regions(p.view(), fractions.view(), trials, threshold)?;
                // Other pixels stay exactly as they are.
                let weights = matched.mapv(|p| if p < 0.5 { 1.0 } else { 0.0 });
                (matched, weights)
            } else {
                return Ok(());
            };
        let intensities = self.intensities(&probabilities)?;
        Zip::from(&mut image)
            .and(&weights)
            .and(&intensities)
            .par_for_each(|image, &weight, &intensity| {
                *image = (1.0 - weight) * *image + weight * intensity;
            });
        Ok(())
    }

    /// Return the intensities at which bits are 1 with the given probabilities.
    fn intensities(&self, probabilities: &Array2<f32>) -> Result<Array2<f32>> {
        let mut out = Array2::zeros(probabilities.dim());
        let (Some(from), Some(to)) = (probabilities.as_slice(), out.as_slice_mut()) else {
            let (shape, strides) = (probabilities.dim(), probabilities.strides());
            return Err(Error::layout(shape, shape, strides));
        };
        mle::from_probability(&self.sensor.response, from, self.sensor.jot, to)?;
        Ok(out)
    }
}
