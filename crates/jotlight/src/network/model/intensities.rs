//! Intensities from the outputs of a network.

use ndarray::ArrayViewMut2;
use rayon::prelude::*;

use super::Served;
use super::reconstruction::Reconstruction;
use crate::error::{Error, Result};
use crate::mle;

/// The number of pixels whose probabilities become intensities in one task.
const PIXELS_PER_TASK: usize = 1 << 12;

impl Reconstruction<'_> {
    /// Replace the outputs of the network with intensities in [0, S].
    pub(super) fn to_intensities(&self, mut out: ArrayViewMut2<'_, f32>) -> Result<()> {
        let (shape, strides) = (out.dim(), out.strides().to_vec());
        let Some(out) = out.as_slice_mut() else {
            return Err(Error::layout(shape, shape, &strides));
        };
        let response = &self.sensor.response;
        let max = response.max_intensity as f32;
        if let Served::Sensor(_) = self.network.served {
            let bounds = self.network.output_bounds;
            if bounds.is_some_and(|(low, high)| low >= 0.0 && high as f32 <= max) {
                return Ok(());
            }
            out.par_chunks_mut(PIXELS_PER_TASK).for_each(|out| {
                for intensity in out.iter_mut() {
                    *intensity = intensity.clamp(0.0, max);
                }
            });
            return Ok(());
        }
        out.par_chunks_mut(PIXELS_PER_TASK).try_for_each(|out| {
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
