//! Counts whose pixels may differ, and the counts that equal jots would show.

use ndarray::{ArrayView2, ArrayViewMut2, CowArray, Ix2};

use super::local_trials::LocalTrials;
use crate::error::{Error, Result};
use crate::mle::JotResponses;
use crate::values::Values;

/// The counts of the pixels of an image, and what is known about each pixel.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    /// The numbers L of ones.
    pub counts: ArrayView2<'a, i32>,
    /// The numbers of bits, above 0.
    pub trials: Values<'a, f64>,
    /// The quantum efficiency and the dark counts of the jots of a pixel.
    pub jots: JotResponses<'a>,
}

/// An image of the counts that jots would show if each of them were the jot of the sensor
/// ([`super::SensorModel::jot`]), with the dark counts for which the network was made.
#[derive(Clone, Debug)]
pub struct EquivalentCounts<'a> {
    /// The counts: finite numbers of at least 0, which need not be whole.
    pub counts: ArrayView2<'a, f32>,
    /// The number of bits of which these counts are the ones.
    pub of: u32,
    /// The number of bits that states the noise of the counts.
    pub trials: LocalTrials,
}

impl EquivalentCounts<'_> {
    /// Check the counts, and that `out` takes their image.
    pub(super) fn check(&self, out: &ArrayViewMut2<'_, f32>) -> Result<()> {
        if self.of == 0 {
            return Err(Error::range("of", "numbers of bits above 0", 0));
        }
        check_ones("counts", self.counts)?;
        if out.dim() != self.counts.dim() || !out.is_standard_layout() {
            return Err(Error::layout(self.counts.dim(), out.dim(), out.strides()));
        }
        Ok(())
    }

    /// Return the counts among K = `level` bits.
    pub(super) fn counts_of(&self, level: u32) -> CowArray<'_, f32, Ix2> {
        if self.of == level {
            return self.counts.view().into();
        }
        let (of, level) = (self.of as f32, level as f32);
        self.counts.mapv(|count| count / of * level).into()
    }
}

/// Check that counts or fractions of ones are finite and at least 0.
pub(super) fn check_ones(what: &'static str, ones: ArrayView2<'_, f32>) -> Result<()> {
    let is_wrong = |ones: &&f32| !(ones.is_finite() && **ones >= 0.0);
    if let Some(wrong) = ones.iter().find(is_wrong) {
        let expected = "finite numbers of at least 0; replace those below it with 0";
        return Err(Error::range(what, expected, wrong));
    }
    Ok(())
}
