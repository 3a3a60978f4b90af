//! One spline per channel: values, equations (8) and (10), and gradients for stacks of planes.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, ArrayViewMut1, ArrayViewMut2, Axis, Zip};
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
#[derive(Clone, Debug)]
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
    /// Only a thread of a pool shares the work with other threads, as one that has called
    /// [`crate::threads::install`] may be.
    ///
    /// # Errors
    /// [`Error::Shape`] if the number of channels is not the number of splines.
    pub fn activate(&self, planes: ArrayView3<'_, F>) -> Result<Array3<F>> {
        self.check_channels(planes.dim())?;
        memory::check::<F>("planes", planes.shape())?;
        let mut out = planes.as_standard_layout().into_owned();
        let apply = |(_, channel): (usize, usize), mut plane: ArrayViewMut1<'_, F>| {
            self.0[channel].apply(plane.as_slice_mut().unwrap_or_default());
        };
        let planes = Zip::indexed(out.lanes_mut(Axis(2)));
        if is_in_pool() {
            planes.par_for_each(apply);
        } else {
            planes.for_each(apply);
        }
        Ok(out)
    }

    /// Return the gradients with respect to planes `(N, C, P)` and coefficients `(C, N_w)`.
    ///
    /// `gradient` is the gradient with respect to the result of [`Splines::activate`]. The result
    /// is the same for any number of threads. Only a thread of a pool
    /// ([`crate::threads::install`]) shares the work with other threads.
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
        let pull_back = |(out, planes): (ArrayViewMut2<'_, F>, ArrayView2<'_, F>)| {
            self.pull_back_item(planes, out)
        };
        let items = out.outer_iter_mut();
        let sums_per_item: Vec<_> = if is_in_pool() {
            let items = items.into_par_iter().zip(planes.outer_iter());
            items.map(pull_back).collect()
        } else {
            items.zip(planes.outer_iter()).map(pull_back).collect()
        };
        // The sums are added in order, so the result does not depend on the number of threads.
        let mut sums = Array2::zeros((channels, coefficients));
        for item in sums_per_item {
            sums += &item;
        }
        Ok((out, sums))
    }

    /// Replace the gradients (C, P) of an item, and return its gradient with respect to the
    /// coefficients.
    fn pull_back_item(
        &self,
        planes: ArrayView2<'_, F>,
        mut gradient: ArrayViewMut2<'_, F>,
    ) -> Array2<f64> {
        let coefficients = self.0.first().map_or(0, Spline::len);
        let mut sums = Array2::zeros((self.0.len(), coefficients));
        let rows = gradient.outer_iter_mut().zip(planes.outer_iter());
        for ((spline, (mut gradient, plane)), mut sums) in
            self.0.iter().zip(rows).zip(sums.outer_iter_mut())
        {
            if interrupt::is_requested() {
                break;
            }
            if let (Some(gradient), Some(plane), Some(sums)) = (
                gradient.as_slice_mut(),
                plane.to_slice(),
                sums.as_slice_mut(),
            ) {
                spline.pull_back(plane, gradient, sums);
            }
        }
        sums
    }

    fn check_channels(&self, (_, channels, _): (usize, usize, usize)) -> Result<()> {
        if channels == self.0.len() {
            return Ok(());
        }
        Err(Error::shape("channels", self.0.len(), channels))
    }
}

fn is_in_pool() -> bool {
    rayon::current_thread_index().is_some()
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
