//! What networks know about a sensor.

use crate::error::{Error, Result};
use crate::mle::{JotResponse, PixelResponse};

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
    /// Check that the numbers are those of a sensor.
    pub(super) fn check(&self) -> Result<()> {
        if self.trials == 0 {
            return Err(Error::range("trials per pixel", "at least 1", 0));
        }
        self.response.check()?;
        self.jot.check()
    }

    /// Return η α/K: the expected detections of a jot per frame at intensity 1.
    pub(super) fn detected_light(&self) -> f64 {
        self.jot.efficiency * self.response.light_per_intensity
    }

    /// Return P(b = 1) at an intensity.
    pub(super) fn detection_probability(&self, intensity: f64) -> f64 {
        let rate = self.detected_light() * intensity.max(0.0) + self.jot.dark_counts;
        self.response.threshold.detection_probability(rate)
    }
}
