//! The evaluation of a network for counts and planes in memory.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, ArrayViewMut2, Axis};

use super::denoise::Denoiser;
use super::local_trials::LocalTrials;
use super::rotations::mean_of_rotations;
use super::{Network, Served};
use crate::bits::PackedBits;
use crate::error::{Error, Result};
use crate::images::for_each_image;
use crate::network::forward;
use crate::network::images::write_images;
use crate::network::layer::Layer;

impl Network {
    /// Return the outputs of a tied network for images of counts L of K = `trials` bits, which need
    /// not be whole. The images may differ in size.
    ///
    /// The outputs are P(b = 1) for networks for many K, or P(b = 0) if `zeros`, and intensities for
    /// other networks. They may lie slightly outside of their range.
    ///
    /// # Errors
    /// [`Error::Range`] for a network that weighs each jot of a pixel, and for a K outside of the
    /// range of the network.
    pub fn run_counts(
        &self,
        counts: Vec<Array2<f32>>,
        trials: u32,
        zeros: bool,
    ) -> Result<Vec<Array2<f32>>> {
        let layers = self.layers_for(f64::from(trials), zeros)?;
        let empty = counts.iter().map(|counts| Array2::zeros(counts.dim()));
        let mut out: Vec<_> = empty.collect();
        let places = out.iter_mut().map(|image| image.view_mut()).collect();
        write_images(counts, places, |counts, out| {
            self.write_counts(&layers, counts.view(), out)
        })?;
        Ok(out)
    }

    /// Return the probabilities P(b = 1) at each pixel of images with fractions of ones, or P(b = 0)
    /// from fractions of zeros.
    ///
    /// The trials of an image are its local trials. They may exceed the largest K of the network, or
    /// be a map. Images that share a map of trials share the work on it.
    ///
    /// # Errors
    /// [`Error::Range`] for networks for one K and for trials that are not above 0.
    /// [`Error::Shape`] if the shapes do not match.
    pub fn denoise(
        &self,
        fractions: &[ArrayView2<'_, f32>],
        trials: &[LocalTrials],
        zeros: bool,
    ) -> Result<Vec<Array2<f32>>> {
        let Served::Trials { min, max } = self.served else {
            let expected = "a network for many K";
            return Err(Error::range("network", expected, "another one"));
        };
        let denoiser = Denoiser {
            network: self,
            zeros,
            range: (min, max),
        };
        denoiser.denoise(fractions, trials)
    }

    /// Return the outputs of a network for planes, such as P(b = 1) of red, green, and blue light,
    /// `(3, H, W)`.
    ///
    /// `trials` is the usual number of bits of a pixel. Outside of the range of the network, the
    /// nearest parameters are used.
    ///
    /// # Errors
    /// [`Error::Range`] for other networks, and [`Error::Shape`] for a wrong number of planes.
    pub fn improve(&self, planes: ArrayView3<'_, f32>, trials: f64) -> Result<Array3<f32>> {
        let Served::Planes { min, max } = self.served else {
            let expected = "a network for planes";
            return Err(Error::range("network", expected, "another one"));
        };
        let layers = self.layers_for(trials.clamp(min.into(), max.into()), false)?;
        let layers: Vec<_> = layers.iter().collect();
        let channels = layers.last().map_or(0, |last| last.channels());
        mean_of_rotations(planes, self.rotations, 1, |planes| {
            let (_, height, width) = planes.dim();
            let mut out = Array3::zeros((channels, height, width));
            forward::forward_planes(&layers, planes, out.view_mut())?;
            Ok(out)
        })
    }

    /// Return the sums of the first layer for the bits of each image, whose dead jots are the same
    /// ([`crate::network::masked_sums`]), for a network for one sensor.
    ///
    /// # Errors
    /// Those of that function.
    pub fn masked_sums(
        &self,
        images: &[PackedBits<'_>],
        valid: ArrayView2<'_, u8>,
    ) -> Result<Vec<Array3<f32>>> {
        let layers = self.layers_for(self.own_trials()?, false)?;
        for_each_image(images, |bits| forward::masked_sums(&layers[0], bits, valid))
    }

    /// Return K of a network for one sensor.
    pub(super) fn own_trials(&self) -> Result<f64> {
        let Served::Sensor(sensor) = self.served else {
            let expected = "a network for one sensor";
            return Err(Error::range("network", expected, "one for many K"));
        };
        Ok(f64::from(sensor.trials))
    }

    /// Write the output of tied layers for counts, which need not be whole.
    pub(super) fn write_counts(
        &self,
        layers: &[Layer<f32>],
        counts: ArrayView2<'_, f32>,
        mut out: ArrayViewMut2<'_, f32>,
    ) -> Result<()> {
        if !self.is_tied() {
            let expected = "bits, because this network weighs each jot of a pixel";
            return Err(Error::range("data", expected, "counts"));
        }
        if counts.dim() != out.dim() {
            return Err(Error::shape("out", counts.dim(), out.dim()));
        }
        let weights = tied_weights(layers);
        let layers: Vec<_> = layers.iter().collect();
        let sums = |counts: ArrayView2<'_, f32>| {
            let (height, width) = counts.dim();
            let shape = (weights.len(), height, width);
            let mut sums = Array3::zeros(shape);
            for (mut plane, &weight) in sums.outer_iter_mut().zip(&weights) {
                plane.zip_mut_with(&counts, |sum, &count| *sum = weight * count);
            }
            sums
        };
        if self.rotations == 1 {
            return forward::forward(&layers, sums(counts).view(), out);
        }
        let counts = counts.insert_axis(Axis(0));
        let mean = mean_of_rotations(counts, self.rotations, self.size_divisor, |counts| {
            let mut out = Array3::zeros(counts.dim());
            let sums = sums(counts.index_axis_move(Axis(0), 0));
            forward::forward_planes(&layers, sums.view(), out.view_mut())?;
            Ok(out)
        })?;
        out.assign(&mean.index_axis(Axis(0), 0));
        Ok(())
    }
}

/// Return the weight of each channel of a tied first layer.
pub(super) fn tied_weights(layers: &[Layer<f32>]) -> Vec<f32> {
    let first = layers.first();
    first.map_or_else(Vec::new, |layer| layer.filters().iter().copied().collect())
}
