//! The learned network (paper, section 3.1): layers of linear filters and pointwise cubic B-splines.

mod forward;
mod lsi;
mod spline;

use ndarray::{Array2, Array4};

use crate::error::{Error, Result};

pub use forward::{block_sums, forward};
pub use spline::Spline;

/// A filter bank followed by one spline per output channel.
#[derive(Clone, Debug)]
pub struct Layer {
    filters: Array4<f32>,
    coefficients: Array2<f32>,
    start: f32,
    spacing: f32,
}

impl Layer {
    /// `filters` are `(C_out, C_in, height, width)`, for the first layer `(C_out, T, K̂, K̂)` or, tied, `(C_out, 1, 1, 1)`;
    /// `coefficients` `(C_out, N_w)` belong to knots at `start` + k·`spacing`.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] for fewer than 4 coefficients, a spacing that is not positive,
    /// and infinity or NaN.
    pub fn new(
        filters: Array4<f32>,
        coefficients: Array2<f32>,
        start: f32,
        spacing: f32,
    ) -> Result<Self> {
        if filters.is_empty() {
            return Err(Error::range(
                "filters",
                "at least one tap",
                format!("{:?}", filters.dim()),
            ));
        }
        if coefficients.nrows() != filters.dim().0 {
            return Err(Error::shape(
                "rows of spline coefficients",
                filters.dim().0,
                coefficients.nrows(),
            ));
        }
        if coefficients.ncols() < 4 {
            return Err(Error::range(
                "spline coefficients",
                "at least 4",
                coefficients.ncols(),
            ));
        }
        if !filters.iter().chain(&coefficients).all(|x| x.is_finite()) {
            return Err(Error::range(
                "filters and spline coefficients",
                "finite numbers",
                "infinity or NaN",
            ));
        }
        if !(spacing > 0.0 && spacing.is_finite() && start.is_finite()) {
            return Err(Error::range("knot spacing", "positive", spacing));
        }
        Ok(Self {
            filters,
            coefficients,
            start,
            spacing,
        })
    }

    /// The number of output channels.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.filters.dim().0
    }

    /// The pointwise function of an output channel.
    #[must_use]
    pub fn spline(&self, channel: usize) -> Spline<'_> {
        Spline::new(self.coefficients.row(channel), self.start, self.spacing)
    }
}
