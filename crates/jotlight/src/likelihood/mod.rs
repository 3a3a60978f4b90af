//! The log-likelihood ℓ of counted bits: its value, its derivatives, the Fisher information, and
//! the proximal map of −ℓ (paper, section 2.2.1).
//!
//! The log-likelihood is ℓ(s) = Σ L log P(q, η s + d) + (n − L) log(1 − P(q, η s + d)), which
//! equation (4) maximizes. An *element* of the sum is a jot, or a pixel whose jots all receive the
//! same light. L of the n readings of an element are ones; n may be a real number, such as a mean.
//! The light s is the expected number of photons per jot and frame. The quantum efficiency η and the
//! dark counts d turn it into the rate η s + d.

mod chunk;
mod one_photon;
mod proximal;
mod proximal_problem;
mod rates;
mod threshold;

use std::ops::Range;

use crate::cpu::levels;
use crate::elements;
use crate::error::{Error, Result, check_shape};
use crate::images::for_each_image;
use crate::values::Values;
use chunk::{Chunk, ELEMENTS_PER_CHUNK, Element};

pub(crate) use rates::Rates;
pub use threshold::Threshold;

/// The smallest rate at which derivatives are evaluated. It replaces rate 0, where the formulas
/// divide by 0 although some derivatives have a limit.
const MIN_RATE: f64 = 1e-150;

/// The readings of a sensor, and the response of its jots. Each element has L ones among n
/// readings.
#[derive(Clone, Copy, Debug)]
pub struct Readings<'a> {
    threshold: Threshold,
    ones: &'a [i32],
    trials: Values<'a, f64>,
    efficiency: Values<'a, f64>,
    dark_counts: Values<'a, f64>,
}

impl<'a> Readings<'a> {
    /// Return readings with L = `ones`, n = `trials`, η = `efficiency`, and d = `dark_counts`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths of the arrays do not match. [`Error::Range`] for a count
    /// outside 0 to n, and for an efficiency or dark counts that are infinite, NaN, or negative.
    pub fn new(
        threshold: Threshold,
        ones: &'a [i32],
        trials: Values<'a, f64>,
        efficiency: Values<'a, f64>,
        dark_counts: Values<'a, f64>,
    ) -> Result<Self> {
        trials.check_length("trials", ones.len())?;
        efficiency.check("efficiency", ones.len())?;
        dark_counts.check("dark counts", ones.len())?;
        check_counts(ones, trials)?;
        Ok(Self {
            threshold,
            ones,
            trials,
            efficiency,
            dark_counts,
        })
    }

    /// Return the readings of a range of elements, such as one image of a stack.
    ///
    /// # Panics
    /// If there are fewer elements.
    #[must_use]
    pub fn part(&self, elements: Range<usize>) -> Self {
        Self {
            threshold: self.threshold,
            ones: &self.ones[elements.clone()],
            trials: self.trials.part(elements.clone()),
            efficiency: self.efficiency.part(elements.clone()),
            dark_counts: self.dark_counts.part(elements),
        }
    }

    /// Return the number of elements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ones.len()
    }

    /// Return whether there are no elements.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ones.is_empty()
    }

    /// Return ℓ, where `light` is the light s of each element. ℓ is −∞ if an element with rate 0
    /// has ones.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths of the arrays do not match.
    pub fn value(&self, light: &[f64]) -> Result<f64> {
        check_shape("light", self.len(), light.len())?;
        Ok(elements::sum(light.len(), ELEMENTS_PER_CHUNK, |index| {
            self.log_likelihood(&self.element(index), light[index])
        }))
    }

    /// Return ℓ of each of `images` images with the same number of elements.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths of the arrays do not match.
    pub fn values(&self, images: usize, light: &[f64]) -> Result<Vec<f64>> {
        check_shape("light", self.len(), light.len())?;
        let size = self.elements_of_image(images)?;
        for_each_image(0..images, |image| {
            let elements = image * size..(image + 1) * size;
            self.part(elements.clone()).value(&light[elements])
        })
    }

    /// Return the number of elements of each of `images` images.
    fn elements_of_image(&self, images: usize) -> Result<usize> {
        let size = self.len().checked_div(images).unwrap_or_default();
        check_shape("elements of the images", images * size, self.len())?;
        Ok(size)
    }

    /// Write ∂ℓ/∂s of each element into `gradient`, and −∂²ℓ/∂s² ≥ 0 into `curvature`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths of the arrays do not match.
    pub fn gradient_and_curvature(
        &self,
        light: &[f64],
        gradient: &mut [f64],
        curvature: &mut [f64],
    ) -> Result<()> {
        check_shape("light", self.len(), light.len())?;
        check_shape("gradient", self.len(), gradient.len())?;
        check_shape("curvature", self.len(), curvature.len())?;
        let write = |chunk: &mut Chunk, first, gradient: &mut [f64], curvature: &mut [f64]| {
            chunk.fill(self, first / ELEMENTS_PER_CHUNK);
            let light = &light[first..];
            if self.threshold.photons() == 1 {
                let light = &light[..gradient.len()];
                return one_photon::gradient_and_curvature(chunk, light, gradient, curvature);
            }
            let outputs = gradient.iter_mut().zip(curvature).zip(light);
            for (index, ((gradient, curvature), &light)) in outputs.enumerate() {
                (*gradient, *curvature) = self.element_derivatives(&chunk.element(index), light);
            }
        };
        elements::write_pairs(
            gradient,
            curvature,
            ELEMENTS_PER_CHUNK,
            Chunk::default,
            write,
        );
        Ok(())
    }

    /// Write the Fisher information of each element about its light, n (η P')² / (P (1 − P)), into
    /// `information`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths of the arrays do not match.
    pub fn information(&self, light: &[f64], information: &mut [f64]) -> Result<()> {
        check_shape("light", self.len(), light.len())?;
        check_shape("information", self.len(), information.len())?;
        elements::write(information, ELEMENTS_PER_CHUNK, |index| {
            self.element_information(index, light[index])
        });
        Ok(())
    }

    fn element_information(&self, index: usize, light: f64) -> f64 {
        let efficiency = self.efficiency.get(index);
        let rate = (efficiency * light + self.dark_counts.get(index)).max(MIN_RATE);
        self.trials.get(index)
            * efficiency
            * efficiency
            * self.threshold.detection_score(rate)
            * self.threshold.non_detection_score(rate)
    }

    /// Return ∂ℓ/∂s and −∂²ℓ/∂s² of one element.
    pub(crate) fn derivatives(&self, index: usize, light: f64) -> (f64, f64) {
        self.element_derivatives(&self.element(index), light)
    }

    /// Return the expected number of ones of an element, and its derivative about the light.
    pub(crate) fn expected_ones(&self, index: usize, light: f64) -> (f64, f64) {
        let (efficiency, trials) = (self.efficiency.get(index), self.trials.get(index));
        let rate = efficiency * light + self.dark_counts.get(index);
        let slope = trials * efficiency * self.threshold.detection_derivative(rate);
        (trials * self.threshold.detection_probability(rate), slope)
    }

    fn element(&self, index: usize) -> Element {
        let ones = f64::from(self.ones[index]);
        Element {
            ones,
            zeros: self.trials.get(index) - ones,
            efficiency: self.efficiency.get(index),
            dark_counts: self.dark_counts.get(index),
        }
    }

    /// Return the term of ℓ for one element.
    fn log_likelihood(&self, element: &Element, light: f64) -> f64 {
        let rate = element.efficiency * light + element.dark_counts;
        // By convention, 0 · log 0 = 0.
        let mut value = 0.0;
        if element.ones > 0.0 {
            value += element.ones * self.threshold.log_detection_probability(rate);
        }
        if element.zeros > 0.0 {
            value += element.zeros * self.threshold.log_non_detection_probability(rate);
        }
        value
    }

    /// Return ∂ℓ/∂s and −∂²ℓ/∂s² of one element.
    #[inline]
    fn element_derivatives(&self, element: &Element, light: f64) -> (f64, f64) {
        let rate = (element.efficiency * light + element.dark_counts).max(MIN_RATE);
        let (mut gradient, mut curvature) = (0.0, 0.0);
        if element.ones > 0.0 {
            let (score, concavity) = self.threshold.detection_score_and_curvature(rate);
            gradient += element.ones * score;
            curvature += element.ones * concavity;
        }
        if element.zeros > 0.0 {
            let (score, concavity) = self.threshold.non_detection_score_and_curvature(rate);
            gradient -= element.zeros * score;
            curvature += element.zeros * concavity;
        }
        (
            element.efficiency * gradient,
            element.efficiency * element.efficiency * curvature,
        )
    }
}

/// Check that each count lies between 0 and the number of readings, which is finite.
pub(crate) fn check_counts(counts: &[i32], trials: Values<'_, f64>) -> Result<()> {
    if let Values::Same(trials) = trials
        && trials < f64::INFINITY
    {
        let (mut min, mut max) = (0, 0);
        include_range(counts, &mut min, &mut max);
        if min == 0 && f64::from(max) <= trials {
            return Ok(());
        }
    }
    for (index, &ones) in counts.iter().enumerate() {
        let trials = trials.get(index);
        if trials.is_nan() || trials == f64::INFINITY {
            return Err(Error::range("trials", "finite numbers", trials));
        }
        if ones < 0 || f64::from(ones) > trials {
            return Err(Error::range("counts", format!("0 to {trials}"), ones));
        }
    }
    Ok(())
}

levels! {
    /// Extend the range from `min` to `max` to all counts.
    fn include_range(counts: &[i32], min: &mut i32, max: &mut i32) = include_range_inlined;
}

#[inline(always)]
fn include_range_inlined(counts: &[i32], min: &mut i32, max: &mut i32) {
    for &count in counts {
        *min = (*min).min(count);
        *max = (*max).max(count);
    }
}
