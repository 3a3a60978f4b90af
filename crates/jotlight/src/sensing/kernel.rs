//! The interpolation kernel: its integrals g over the jots (paper, equations (1) and (2)).

use std::ops::Range;

use num_integer::div_rem;

use crate::error::{Error, Result};

/// The integrals g of a B-spline over the jots, with K̂ jots per pixel and dimension.
///
/// The B-spline of degree 0 is the box of equation (1), and its integrals are equation (2). The
/// maximum degree is 3.
///
/// `Differs from the paper:` the kernel is centered on its pixel, so that a smooth kernel does not
/// shift the image. If degree·K̂ is odd, the center lies half a jot too far to the right, because
/// the kernel can only move by whole jots.
#[derive(Clone, Debug)]
pub struct Kernel {
    taps: Vec<f64>,
    oversampling: usize,
    /// The number of jots by which centering moves the kernel to the left.
    shift: usize,
}

impl Kernel {
    /// The maximum oversampling K̂. It exceeds that of any sensor.
    pub const MAX_OVERSAMPLING: usize = 4096;

    /// Return the kernel for a degree of the B-spline and K̂ = `oversampling` jots per pixel.
    ///
    /// # Errors
    /// [`Error::Range`] for a degree above 3, and for a K̂ that is not 1 to
    /// [`Kernel::MAX_OVERSAMPLING`].
    pub fn new(degree: usize, oversampling: usize) -> Result<Self> {
        if degree > 3 {
            return Err(Error::range("kernel degree", "0 to 3", degree));
        }
        if !(1..=Self::MAX_OVERSAMPLING).contains(&oversampling) {
            let expected = format!("1 to {}", Self::MAX_OVERSAMPLING);
            return Err(Error::range("oversampling", expected, oversampling));
        }
        let integral = |m: usize| spline_integral(degree, m as f64 / oversampling as f64);
        Ok(Self {
            taps: (0..(degree + 1) * oversampling)
                .map(|m| integral(m + 1) - integral(m))
                .collect(),
            oversampling,
            shift: degree * oversampling / 2,
        })
    }

    /// Return g, the integral over each jot, from the first jot to the last. The sum is 1.
    #[must_use]
    pub fn taps(&self) -> &[f64] {
        &self.taps
    }

    /// Return the oversampling K̂.
    #[must_use]
    pub fn oversampling(&self) -> usize {
        self.oversampling
    }

    /// Return the degree of the B-spline.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.taps.len() / self.oversampling - 1
    }

    /// Return the last pixel whose light reaches a jot, and the position of the jot relative to it.
    ///
    /// The light of degree + 1 consecutive pixels reaches each jot.
    ///
    /// `Differs from the paper:` the image continues symmetrically beyond its border, see
    /// [`crate::border`]. In the paper the image is 0 there, which darkens the border.
    pub(super) fn last_pixel(&self, jot: usize) -> (isize, usize) {
        let (pixel, position) = div_rem(jot + self.shift, self.oversampling);
        (pixel as isize, position)
    }

    /// Return the rows of an image whose light reaches rows of jots.
    ///
    /// The rows of the symmetric continuation repeat some of them.
    pub(super) fn rows_of_pixels(&self, jots: Range<usize>, height: usize) -> Range<usize> {
        if jots.is_empty() {
            return 0..0;
        }
        let [first, last] = [jots.start, jots.end - 1].map(|jot| self.last_pixel(jot).0 as usize);
        first.saturating_sub(self.degree())..(last + 1).min(height)
    }

    /// Return the taps of the pixels whose light reaches a jot, from the last pixel to the first.
    ///
    /// `position` is the position of the jot that [`Kernel::last_pixel`] returns.
    pub(super) fn pixel_taps(&self, position: usize) -> impl Iterator<Item = f64> {
        self.taps[position..]
            .iter()
            .step_by(self.oversampling)
            .copied()
    }
}

/// Return the integral from 0 to `x` of the B-spline with knots 0, 1, …, degree + 1.
fn spline_integral(degree: usize, x: f64) -> f64 {
    let order = degree + 1;
    let middle = 0.5 * order as f64;
    if x > middle {
        // The spline is symmetric. In its right half, large terms of the sum below would cancel.
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
    use crate::border::mirror_index;

    #[test]
    fn the_box_lights_all_jots_of_a_pixel_equally() -> Result<()> {
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
                // A constant image lights all jots equally.
                for phase in 0..oversampling {
                    let light: f64 = kernel.taps()[phase..].iter().step_by(oversampling).sum();
                    assert!((light * oversampling as f64 - 1.0).abs() < 1e-14);
                }
            }
        }
        Ok(())
    }

    #[test]
    fn the_rows_of_pixels_are_those_whose_light_reaches_jots() -> Result<()> {
        for (degree, oversampling) in (0..=3).flat_map(|degree| (1..5).map(move |k| (degree, k))) {
            let kernel = Kernel::new(degree, oversampling)?;
            for height in 1..6 {
                for (start, end) in
                    (0..height).flat_map(|start| (start..=height).map(move |end| (start, end)))
                {
                    let jots = start * oversampling..end * oversampling;
                    let mut expected = vec![false; height];
                    for jot in jots.clone() {
                        let last = kernel.last_pixel(jot).0;
                        for distance in 0..=degree as isize {
                            expected[mirror_index(last - distance, height)] = true;
                        }
                    }
                    let rows = kernel.rows_of_pixels(jots, height);
                    let found: Vec<_> = (0..height).map(|row| rows.contains(&row)).collect();
                    assert_eq!(
                        found, expected,
                        "degree {degree}, {start}..{end} of {height}"
                    );
                }
            }
        }
        Ok(())
    }
}
