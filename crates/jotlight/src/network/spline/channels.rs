//! One spline per channel: values, equations (8) and (10), and gradients for stacks of planes.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis, Zip};
use rayon::prelude::*;

use super::evaluate::{Spline, TABLE};
use crate::bits::contiguous;
use crate::error::{Error, Result};
use crate::numbers::Real;
use crate::{interrupt, memory};

/// The maximum number of coefficients of a spline. The index of a knot interval must fit into the
/// mantissa of an `f32`.
const MAX_COEFFICIENTS: usize = 1 << 20;

/// Splines without filters, one per channel. PyTorch networks use them as their nonlinearities.
pub struct Splines<F>(Vec<Spline<F>>);

impl<F: Real> Splines<F> {
    /// Return splines with coefficients `(C, N_w)` and knots at `start` + k·`spacing`.
    ///
    /// # Errors
    /// [`Error::Range`] for fewer than 4 coefficients per channel, a spacing that is not positive,
    /// or a value that is not finite.
    pub fn new(coefficients: ArrayView2<'_, F>, start: F, spacing: F) -> Result<Self> {
        Ok(Self(build_splines(coefficients, start, spacing)?))
    }

    /// Apply the spline of each channel to planes `(N, C, P)`, and return the results.
    ///
    /// # Errors
    /// [`Error::Shape`] if the number of channels is not the number of splines.
    pub fn activate(&self, planes: ArrayView3<'_, F>) -> Result<Array3<F>> {
        self.check_channels(planes.dim())?;
        memory::check::<F>("planes", planes.shape())?;
        let mut out = planes.as_standard_layout().into_owned();
        Zip::indexed(out.lanes_mut(Axis(2))).par_for_each(|(_, channel), mut plane| {
            let plane = plane.as_slice_mut().unwrap_or_default();
            self.0[channel].apply(plane);
        });
        Ok(out)
    }

    /// Return the gradients with respect to planes `(N, C, P)` and coefficients `(C, N_w)`.
    ///
    /// `gradient` is the gradient with respect to the result of [`Splines::activate`]. The result
    /// is the same for any number of threads.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes of the arrays do not match.
    pub fn pull_back(
        &self,
        planes: ArrayView3<'_, F>,
        gradient: ArrayView3<'_, F>,
    ) -> Result<(Array3<F>, Array2<f64>)> {
        self.check_channels(planes.dim())?;
        if gradient.dim() != planes.dim() {
            return Err(Error::shape("gradient", planes.dim(), gradient.dim()));
        }
        let (_, channels, _) = planes.dim();
        let coefficients = self.0.first().map_or(0, Spline::len);
        memory::check::<F>("planes", planes.shape())?;
        memory::check::<f64>(
            "gradients of the coefficients",
            &[planes.dim().0, channels, coefficients],
        )?;
        let planes = planes.as_standard_layout();
        let mut out = gradient.as_standard_layout().into_owned();
        let sums_per_item: Vec<_> = out
            .outer_iter_mut()
            .into_par_iter()
            .zip(planes.outer_iter())
            .map(|(mut out, planes)| {
                let mut sums = Array2::zeros((channels, coefficients));
                let rows = out.outer_iter_mut().zip(planes.outer_iter());
                for ((spline, (mut out, plane)), mut sums) in
                    self.0.iter().zip(rows).zip(sums.outer_iter_mut())
                {
                    if interrupt::is_requested() {
                        break;
                    }
                    if let (Some(out), Some(plane), Some(sums)) =
                        (out.as_slice_mut(), plane.to_slice(), sums.as_slice_mut())
                    {
                        spline.pull_back(plane, out, sums);
                    }
                }
                sums
            })
            .collect();
        // The sums are added in order, so the result does not depend on the number of threads.
        let mut sums = Array2::zeros((channels, coefficients));
        for item in sums_per_item {
            sums += &item;
        }
        Ok((out, sums))
    }

    fn check_channels(&self, (_, channels, _): (usize, usize, usize)) -> Result<()> {
        if channels == self.0.len() {
            return Ok(());
        }
        Err(Error::shape("channels", self.0.len(), channels))
    }
}

/// Return one spline for each row of coefficients.
pub(crate) fn build_splines<F: Real>(
    coefficients: ArrayView2<'_, F>,
    start: F,
    spacing: F,
) -> Result<Vec<Spline<F>>> {
    let what = "spline coefficients";
    if !(4..=MAX_COEFFICIENTS).contains(&coefficients.ncols()) {
        let expected = "4 to 2^20 per channel";
        return Err(Error::range(what, expected, coefficients.ncols()));
    }
    memory::check::<[[F; TABLE]; 4]>(what, &[coefficients.nrows()])?;
    memory::check::<[F; 4]>(what, coefficients.shape())?;
    if !coefficients.iter().all(|x| x.is_finite()) {
        return Err(Error::range(what, "finite values", "infinity or NaN"));
    }
    if !(spacing > F::zero() && spacing.is_finite() && start.is_finite()) {
        return Err(Error::range("knot spacing", "positive", spacing));
    }
    let rows = coefficients.rows().into_iter();
    Ok(rows
        .map(|row| Spline::new(&contiguous(row), start, spacing))
        .collect())
}
