//! The interpolation kernel φ of the light field and its integrals g over the jots.

use crate::error::{Error, Result};

/// A B-spline of degree 0 (the box of equation (2)) to 3, sampled by K̂ jots per pixel and dimension.
///
/// `Differs from the paper:` the kernel is centred on its pixel, so that a smooth one does not shift the picture. Where
/// degree·K̂ is odd the centre falls half a jot to the right, since the number of taps stays (degree + 1)·K̂.
#[derive(Clone, Debug)]
pub struct Kernel {
    taps: Vec<f64>,
    oversampling: usize,
    reach: usize,
}

impl Kernel {
    /// The kernel of a degree for K̂ = `oversampling` jots.
    ///
    /// # Errors
    /// [`Error::Range`] for a degree past 3 or K̂ = 0.
    pub fn new(degree: usize, oversampling: usize) -> Result<Self> {
        if degree > 3 {
            return Err(Error::range("kernel degree", "0 to 3", degree));
        }
        if oversampling == 0 {
            return Err(Error::range("oversampling", "at least 1", oversampling));
        }
        let edge = |m: usize| spline_integral(degree, m as f64 / oversampling as f64);
        Ok(Self {
            taps: (0..(degree + 1) * oversampling)
                .map(|m| edge(m + 1) - edge(m))
                .collect(),
            oversampling,
            reach: degree * oversampling / 2,
        })
    }

    /// g: one integral a jot, in order, with sum 1.
    #[must_use]
    pub fn taps(&self) -> &[f64] {
        &self.taps
    }

    /// K̂.
    #[must_use]
    pub fn oversampling(&self) -> usize {
        self.oversampling
    }

    /// The degree of the B-spline.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.taps.len() / self.oversampling - 1
    }

    /// The last of the degree + 1 pixels that light jot `jot`, and the tap that weighs it; the pixel before it has the tap K̂
    /// further on, and so forth.
    ///
    /// `Differs from the paper:` where such a pixel lies past the rim, the scene goes on [`mirrored`]; there the light ends with
    /// the picture, which would dim its rim.
    pub(super) fn last_pixel(&self, jot: usize) -> (isize, usize) {
        let place = jot + self.reach;
        (
            (place / self.oversampling) as isize,
            place % self.oversampling,
        )
    }
}

/// The index inside of `0..size` that symmetric continuation puts at `index`: … 1 0 | 0 1 2 … n−1 | n−1 n−2 …
pub(crate) fn mirrored(index: isize, size: usize) -> usize {
    if (0..size as isize).contains(&index) {
        return index as usize;
    }
    let folded = index.rem_euclid(2 * size as isize) as usize;
    folded.min(2 * size - 1 - folded)
}

/// ∫ from 0 to x of the B-spline with knots 0, 1, …, degree + 1.
fn spline_integral(degree: usize, x: f64) -> f64 {
    let order = degree + 1;
    let middle = 0.5 * order as f64;
    if x > middle {
        // The terms of the sum below grow and cancel towards the right end; the spline is even.
        return 1.0 - spline_integral(degree, order as f64 - x);
    }
    let mut binomial = 1.0;
    let mut sum = 0.0;
    let mut factorial = 1.0;
    for k in 0..=order {
        sum += binomial * (x - k as f64).max(0.0).powi(order as i32);
        binomial *= -((order - k) as f64) / (k + 1) as f64;
        factorial *= if k > 0 { k as f64 } else { 1.0 };
    }
    sum / factorial
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_spreads_a_pixel_evenly() -> Result<()> {
        assert_eq!(Kernel::new(0, 4)?.taps(), [0.25; 4]);
        Ok(())
    }

    #[test]
    fn taps_are_a_partition_of_unity() -> Result<()> {
        for degree in 0..=3 {
            for oversampling in 1..=10 {
                let kernel = Kernel::new(degree, oversampling)?;
                assert_eq!(kernel.taps().len(), (degree + 1) * oversampling);
                assert!((kernel.taps().iter().sum::<f64>() - 1.0).abs() < 1e-14);
                // A constant image lights every jot alike.
                for phase in 0..oversampling {
                    let light: f64 = kernel.taps()[phase..].iter().step_by(oversampling).sum();
                    assert!((light * oversampling as f64 - 1.0).abs() < 1e-14);
                }
            }
        }
        Ok(())
    }

    #[test]
    fn mirrored_repeats_the_edge() {
        let row: Vec<usize> = (-4..8).map(|index| mirrored(index, 3)).collect();
        assert_eq!(row, [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]);
    }
}
