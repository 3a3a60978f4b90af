//! The learned network (paper, section 3.1): layers of linear filters and pointwise cubic B-splines.
//!
//! Everything is written for numbers of either width: `f32` does the work, and `f64` of the same code tells what it should give.

mod backward;
mod batch;
mod block;
mod codes;
mod correlate;
mod forward;
mod look_up;
mod lsi;
mod real;
mod spline;
mod tangent;

use std::sync::OnceLock;

use lsi::Filters;
use ndarray::{Array2, Array4, ArrayView4};

use crate::bits::contiguous;
use crate::error::{Error, Result};

pub use batch::{Batch, Gradient, NormalEquations, Patch};
pub use forward::{forward, forward_bits, forward_counts, masked_sums};
pub use real::Real;
pub use spline::Spline;

/// A filter bank followed by one spline per output channel.
#[derive(Clone, Debug)]
pub struct Layer<F> {
    filters: Array4<F>,
    /// The filters in the order of the loops, of layers that read planes: made when they are first needed.
    taps: OnceLock<Filters<F>>,
    splines: Vec<Spline<F>>,
}

impl<F: Real> Layer<F> {
    /// `filters` are `(C_out, C_in, height, width)`, for the first layer `(C_out, T, K̂, K̂)` or, tied, `(C_out, 1, 1, 1)`;
    /// `coefficients` `(C_out, N_w)` belong to knots at `start` + k·`spacing`.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] for fewer than 4 coefficients, a spacing that is not positive,
    /// and infinity or NaN.
    pub fn new(filters: Array4<F>, coefficients: Array2<F>, start: F, spacing: F) -> Result<Self> {
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
        if !(spacing > F::zero() && spacing.is_finite() && start.is_finite()) {
            return Err(Error::range("knot spacing", "positive", spacing));
        }
        let splines = coefficients
            .rows()
            .into_iter()
            .map(|row| Spline::new(&contiguous(row), start, spacing))
            .collect();
        Ok(Self {
            taps: OnceLock::new(),
            filters,
            splines,
        })
    }

    /// The filters `(C_out, C_in, height, width)`.
    #[must_use]
    pub fn filters(&self) -> ArrayView4<'_, F> {
        self.filters.view()
    }

    fn taps(&self) -> &Filters<F> {
        self.taps.get_or_init(|| Filters::new(self.filters.view()))
    }

    /// The pointwise functions, one per output channel.
    #[must_use]
    pub fn splines(&self) -> &[Spline<F>] {
        &self.splines
    }

    /// The number of taps and coefficients.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.filters.len() + self.splines.iter().map(Spline::len).sum::<usize>()
    }

    /// φ of planes `(C, H, W)`, in place: equations (8) and (10).
    fn bend(&self, planes: &mut [F]) {
        let pixels = planes.len() / self.splines.len();
        for (spline, plane) in self.splines.iter().zip(planes.chunks_exact_mut(pixels)) {
            spline.apply(plane);
        }
    }
}

/// Checks that each layer reads what the one before it gives, and that the last gives one plane.
fn check_chain<F: Real>(layers: &[Layer<F>]) -> Result<()> {
    let Some(last) = layers.last() else {
        return Err(Error::range("layers", "at least one", 0));
    };
    for (before, layer) in layers.iter().zip(&layers[1..]) {
        let (outputs, inputs) = (before.filters.dim().0, layer.filters.dim().1);
        if inputs != outputs {
            return Err(Error::shape("input channels of a layer", outputs, inputs));
        }
    }
    if last.filters.dim().0 != 1 {
        return Err(Error::shape(
            "output channels of the last layer",
            1,
            last.filters.dim().0,
        ));
    }
    Ok(())
}
