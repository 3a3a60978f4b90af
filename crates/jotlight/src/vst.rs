//! Variance stabilisation of binomial counts (paper, equations (6) and (7)).
//!
//! After T the noise is close to normal with standard deviation 1/2, whatever the light.

use ndarray::{ArrayView1, ArrayViewMut1};
use rayon::prelude::*;

use crate::error::{Error, Result};

/// The transform for counts out of K bits.
#[derive(Clone, Copy, Debug)]
pub struct Anscombe {
    bits: f64,
}

impl Anscombe {
    /// For counts out of `bits` = K.
    ///
    /// # Errors
    /// [`Error::Range`] for K = 0.
    pub fn new(bits: u32) -> Result<Self> {
        if bits == 0 {
            return Err(Error::range("bits per pixel", "at least 1", bits));
        }
        Ok(Self {
            bits: f64::from(bits),
        })
    }

    /// T: equation (6).
    #[must_use]
    pub fn stabilise(&self, count: f64) -> f64 {
        // A float32 count may lie above K where K is beyond 2²⁴.
        let share = ((count + 0.375) / (self.bits + 0.75)).min(1.0);
        (self.bits + 0.5).sqrt() * share.sqrt().asin()
    }

    /// T⁻¹: equation (7), for z inside of the range of T, and clipped to [0, K].
    #[must_use]
    pub fn algebraic_inverse(&self, z: f64) -> f64 {
        let angle = (z / (self.bits + 0.5).sqrt()).clamp(0.0, std::f64::consts::FRAC_PI_2);
        ((self.bits + 0.75) * angle.sin().powi(2) - 0.375).clamp(0.0, self.bits)
    }

    /// E\[T(L)\] for L ~ Binomial(K, p).
    #[must_use]
    pub fn expectation(&self, probability: f64) -> f64 {
        // From the most likely count outwards: the weights fall from 1, so nothing over- or underflows for any K.
        let mode = ((self.bits + 1.0) * probability).floor().min(self.bits);
        let odds = probability / (1.0 - probability);
        let (mut total, mut sum) = (1.0, self.stabilise(mode));
        let mut add = |weight: f64, count: f64| {
            total += weight;
            sum += weight * self.stabilise(count);
        };
        let (mut weight, mut count) = (1.0, mode);
        while count < self.bits && weight > 1e-18 {
            weight *= (self.bits - count) / (count + 1.0) * odds;
            count += 1.0;
            add(weight, count);
        }
        (weight, count) = (1.0, mode);
        while count > 0.0 && weight > 1e-18 {
            weight *= count / (self.bits - count + 1.0) / odds;
            count -= 1.0;
            add(weight, count);
        }
        sum / total
    }
}

/// The exact unbiased inverse: maps E\[T(L)\], L ~ Binomial(K, p), to K p.
#[derive(Clone, Debug)]
pub struct ExactInverse {
    bits: f64,
    expectations: Vec<f64>,
    counts: Vec<f64>,
}

impl ExactInverse {
    /// Nodes of the table, at p = sin² of even angles: dense where T is steep. Linear interpolation between them is off by
    /// less than 10⁻⁶ K.
    const NODES: usize = 2048;

    /// Tabulates the inverse for counts out of `bits` = K.
    ///
    /// # Errors
    /// [`Error::Range`] for K = 0.
    pub fn new(bits: u32) -> Result<Self> {
        let transform = Anscombe::new(bits)?;
        let probabilities: Vec<f64> = (0..=Self::NODES)
            .map(|node| {
                let angle = std::f64::consts::FRAC_PI_2 * node as f64 / Self::NODES as f64;
                angle.sin().powi(2)
            })
            .collect();
        let expectations = probabilities
            .par_iter()
            .enumerate()
            .map(|(node, &p)| match node {
                0 => transform.stabilise(0.0),
                Self::NODES => transform.stabilise(transform.bits),
                _ => transform.expectation(p),
            })
            .collect();
        let counts = probabilities.iter().map(|p| p * transform.bits).collect();
        Ok(Self {
            bits: transform.bits,
            expectations,
            counts,
        })
    }

    /// K p for z = E\[T(L)\]; 0 or K for a z that no p gives.
    #[must_use]
    pub fn invert(&self, z: f64) -> f64 {
        let above = self.expectations.partition_point(|&value| value <= z);
        if above == 0 {
            0.0
        } else if above > Self::NODES {
            self.bits
        } else {
            let (left, right) = (self.expectations[above - 1], self.expectations[above]);
            let share = (z - left) / (right - left);
            self.counts[above - 1] + share * (self.counts[above] - self.counts[above - 1])
        }
    }
}

/// Applies `function` to every value, in parallel.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn map(
    values: ArrayView1<'_, f32>,
    out: ArrayViewMut1<'_, f32>,
    function: impl Fn(f64) -> f64 + Sync,
) -> Result<()> {
    if values.len() != out.len() {
        return Err(Error::shape("out", values.len(), out.len()));
    }
    ndarray::Zip::from(out)
        .and(values)
        .par_for_each(|out, &value| *out = function(f64::from(value)) as f32);
    Ok(())
}
