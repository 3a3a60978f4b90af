//! G as a linear operator on images and signals, and its exact adjoint.

use ndarray::{Array2, ArrayView2, ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::kernel::{Kernel, mirrored};
use super::rate::filter;
use crate::bits::contiguous;
use crate::error::{Error, Result};

/// G: the light that each jot gets from an image of the intensities c, down the columns by one kernel and along the rows by another.
///
/// A signal is an image of one row whose kernel down the columns is the box of a single jot.
#[derive(Clone, Debug)]
pub struct Spread {
    down: Kernel,
    along: Kernel,
}

impl Spread {
    /// The operator of two kernels.
    #[must_use]
    pub fn new(down: Kernel, along: Kernel) -> Self {
        Self { down, along }
    }

    /// `out = gain · G image`, with `out` of (H·K̂, W·K̂).
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit.
    pub fn forward(
        &self,
        gain: f64,
        image: ArrayView2<'_, f64>,
        mut out: ArrayViewMut2<'_, f64>,
    ) -> Result<()> {
        self.check(image.dim(), out.dim())?;
        let width = out.ncols();
        out.axis_iter_mut(Axis(0))
            .into_par_iter()
            .enumerate()
            .for_each_init(Vec::new, |light, (row, mut out)| {
                filter(&self.down, &self.along, image, row, 0..width, light);
                for (out, light) in out.iter_mut().zip(light.iter()) {
                    *out = gain * light;
                }
            });
        Ok(())
    }

    /// `out = gain · Gᵀ jots`, with `out` of (H, W): ⟨G x, y⟩ = ⟨x, Gᵀ y⟩ to rounding, the mirrored rim included.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit.
    pub fn adjoint(
        &self,
        gain: f64,
        jots: ArrayView2<'_, f64>,
        out: ArrayViewMut2<'_, f64>,
    ) -> Result<()> {
        self.check(out.dim(), jots.dim())?;
        self.gather(gain, out, |row, light| {
            light.clear();
            light.extend_from_slice(&contiguous(jots.row(row)));
        });
        Ok(())
    }

    /// `out = gain² · Gᵀ diag(weights) G image`, and no map over the jots is made on the way.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit.
    pub fn normal(
        &self,
        gain: f64,
        weights: ArrayView2<'_, f64>,
        image: ArrayView2<'_, f64>,
        out: ArrayViewMut2<'_, f64>,
    ) -> Result<()> {
        self.check(image.dim(), weights.dim())?;
        self.check(out.dim(), weights.dim())?;
        self.gather(gain * gain, out, |row, light| {
            filter(
                &self.down,
                &self.along,
                image,
                row,
                0..weights.ncols(),
                light,
            );
            for (light, weight) in light.iter_mut().zip(weights.row(row)) {
                *light *= weight;
            }
        });
        Ok(())
    }

    /// `out = gain · Gᵀ` of the jots that `light_of` gives, row by row.
    fn gather(
        &self,
        gain: f64,
        mut out: ArrayViewMut2<'_, f64>,
        light_of: impl Fn(usize, &mut Vec<f64>) + Sync,
    ) {
        let (height, width) = out.dim();
        let jot_rows = height * self.down.oversampling();
        let mut rows = Array2::<f64>::zeros((jot_rows, width));
        rows.axis_iter_mut(Axis(0))
            .into_par_iter()
            .enumerate()
            .for_each_init(
                || (Vec::new(), Vec::new()),
                |(light, padded), (index, mut row)| {
                    light_of(index, light);
                    self.gather_along(light, row.as_slice_mut().unwrap_or_default(), padded);
                },
            );

        // The rows of jots that each row of pixels lights, and how strongly.
        let mut lit: Vec<Vec<(usize, f64)>> = vec![Vec::new(); height];
        for row in 0..jot_rows {
            let (bottom, line) = self.down.last_pixel(row);
            let taps = self.down.taps()[line..].iter();
            for (back, &tap) in taps.step_by(self.down.oversampling()).enumerate() {
                lit[mirrored(bottom - back as isize, height)].push((row, gain * tap));
            }
        }
        out.axis_iter_mut(Axis(0))
            .into_par_iter()
            .zip(lit)
            .for_each(|(mut out, lit)| {
                out.fill(0.0);
                for (row, weight) in lit {
                    out.scaled_add(weight, &rows.row(row));
                }
            });
    }

    /// What the pixels of a row get back from a row of jots: the adjoint of the second half of [`filter`].
    fn gather_along(&self, jots: &[f64], row: &mut [f64], padded: &mut Vec<f64>) {
        let side = self.along.oversampling();
        let degree = self.along.degree();
        let (first, phase) = self.along.last_pixel(0);
        let (last, _) = self.along.last_pixel(jots.len() - 1);
        let start = first - degree as isize;
        padded.clear();
        padded.resize((last - start + 1) as usize, 0.0);
        for (place, &jot) in (phase..).zip(jots) {
            let taps = self.along.taps()[place % side..].iter().step_by(side);
            let pixels = &mut padded[place / side..];
            for (back, &tap) in taps.enumerate() {
                pixels[degree - back] += tap * jot;
            }
        }
        row.fill(0.0);
        for (pixel, &light) in (start..).zip(padded.iter()) {
            row[mirrored(pixel, row.len())] += light;
        }
    }

    fn check(&self, image: (usize, usize), jots: (usize, usize)) -> Result<()> {
        if image.0 == 0 || image.1 == 0 {
            return Err(Error::shape("image", "at least one pixel", image));
        }
        let expected = (
            image.0 * self.down.oversampling(),
            image.1 * self.along.oversampling(),
        );
        if jots == expected {
            Ok(())
        } else {
            Err(Error::shape("jots", expected, jots))
        }
    }
}
