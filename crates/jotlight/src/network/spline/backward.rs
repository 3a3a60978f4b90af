//! Splines alone, over stacks of planes, for networks that are put together elsewhere.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis, Zip};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::network::layer::splines_of;
use crate::network::spline::evaluate::Spline;
use crate::numbers::Real;

/// Splines of many channels: coefficients `(C, N_w)` of knots at `start` + k·`spacing`.
pub struct Splines<F>(Vec<Spline<F>>);

impl<F: Real> Splines<F> {
    /// One of each row of coefficients.
    ///
    /// # Errors
    /// [`Error::Range`] for fewer than 4 coefficients, a spacing that is not positive, and infinity or NaN.
    pub fn new(coefficients: ArrayView2<'_, F>, start: F, spacing: F) -> Result<Self> {
        Ok(Self(splines_of(coefficients, start, spacing)?))
    }

    /// φ of planes `(N, C, P)`, each channel by its own.
    ///
    /// # Errors
    /// [`Error::Shape`] for another number of channels.
    pub fn bend(&self, planes: ArrayView3<'_, F>) -> Result<Array3<F>> {
        self.check(planes.dim())?;
        let mut out = planes.to_owned();
        Zip::indexed(out.lanes_mut(Axis(2))).par_for_each(|(_, channel), mut plane| {
            if let Some(plane) = plane.as_slice_mut() {
                self.0[channel].apply(plane);
            }
        });
        Ok(out)
    }

    /// The gradient with respect to planes and coefficients `(C, N_w)`, given that of [`Splines::bend`]; the same for any number of threads.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit.
    pub fn push(
        &self,
        planes: ArrayView3<'_, F>,
        gradient: ArrayView3<'_, F>,
    ) -> Result<(Array3<F>, Array2<f64>)> {
        self.check(planes.dim())?;
        if gradient.dim() != planes.dim() {
            return Err(Error::shape("gradient", planes.dim(), gradient.dim()));
        }
        let (_, channels, _) = planes.dim();
        let number = self.0.first().map_or(0, Spline::len);
        let planes = planes.as_standard_layout();
        let mut out = gradient.to_owned();
        let parts: Vec<_> = out
            .outer_iter_mut()
            .into_par_iter()
            .zip(planes.outer_iter())
            .map(|(mut out, planes)| {
                let mut sums = Array2::zeros((channels, number));
                let rows = out.outer_iter_mut().zip(planes.outer_iter());
                for ((spline, (mut out, plane)), mut sums) in
                    self.0.iter().zip(rows).zip(sums.outer_iter_mut())
                {
                    if let (Some(out), Some(plane), Some(sums)) =
                        (out.as_slice_mut(), plane.to_slice(), sums.as_slice_mut())
                    {
                        spline.push(plane, out, sums);
                    }
                }
                sums
            })
            .collect();
        let mut sums = Array2::zeros((channels, number));
        for part in parts {
            sums += &part;
        }
        Ok((out, sums))
    }

    fn check(&self, (_, channels, _): (usize, usize, usize)) -> Result<()> {
        if channels == self.0.len() {
            return Ok(());
        }
        Err(Error::shape("channels", self.0.len(), channels))
    }
}
