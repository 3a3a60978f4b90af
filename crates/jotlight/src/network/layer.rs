//! A layer of the network, and how it is put among the others.

use std::sync::OnceLock;

use ndarray::{Array4, ArrayView2, ArrayView4};

use super::convolution::adjoint::{Filters, Turned};
use super::convolution::winograd::Fast;
use super::spline::evaluate::Spline;
use crate::bits::contiguous;
use crate::error::{Error, Result};
use crate::numbers::Real;

/// A filter bank followed by one spline per output channel: φ(D(h * u) + v), with u the planes that it reads, D from depth to space, and v
/// kept planes.
#[derive(Clone, Debug)]
pub struct Layer<F> {
    pub(super) filters: Array4<F>,
    /// The filters in the order of the loops, of layers that read planes: made when they are first needed.
    taps: OnceLock<Filters<F>>,
    turned: OnceLock<Turned<F>>,
    /// The filters of those that are quicker in another way.
    fast: OnceLock<Option<Fast<F>>>,
    /// None where the sums stay as they are.
    pub(super) splines: Vec<Spline<F>>,
    pub(super) wiring: Wiring,
}

/// How a layer is put among the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// Rows and columns of what is read from one output to the next.
    pub stride: usize,
    /// From depth to space: so many rows and columns in place of one, taken from the channels.
    pub upsampling: usize,
    /// The layer whose planes are read, if it is not the one before.
    pub reads: Option<usize>,
    /// The layer whose planes are added.
    pub adds: Option<usize>,
}

impl Default for Wiring {
    fn default() -> Self {
        Self {
            stride: 1,
            upsampling: 1,
            reads: None,
            adds: None,
        }
    }
}

impl<F: Real> Layer<F> {
    /// `filters` are `(C, C_in, height, width)`, for the first layer `(C, T, K̂, K̂)` or, tied, `(C, 1, 1, 1)`;
    /// `coefficients` `(C / upsampling², N_w)` belong to knots at `start` + k·`spacing`.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] for fewer than 4 coefficients, a spacing that is not positive,
    /// infinity or NaN, and a stride that is larger than the filters.
    pub fn new(
        filters: Array4<F>,
        coefficients: Option<ArrayView2<'_, F>>,
        start: F,
        spacing: F,
        wiring: Wiring,
    ) -> Result<Self> {
        let (outputs, _, lines, columns) = filters.dim();
        if filters.is_empty() {
            let given = format!("{:?}", filters.dim());
            return Err(Error::range("filters", "at least one tap", given));
        }
        if !filters.iter().all(|x| x.is_finite()) {
            return Err(Error::range("filters", "finite numbers", "infinity or NaN"));
        }
        let Wiring {
            stride, upsampling, ..
        } = wiring;
        if !(1..=lines.min(columns)).contains(&stride) {
            return Err(Error::range(
                "stride",
                "1 to the size of the filters",
                stride,
            ));
        }
        if upsampling == 0 || !outputs.is_multiple_of(upsampling * upsampling) {
            let expected = "one whose square divides the number of filters";
            return Err(Error::range("upsampling", expected, upsampling));
        }
        let splines = match coefficients {
            None => Vec::new(),
            Some(coefficients) => splines_of(coefficients, start, spacing)?,
        };
        let channels = outputs / (upsampling * upsampling);
        if coefficients.is_some() && splines.len() != channels {
            let given = splines.len();
            return Err(Error::shape("rows of spline coefficients", channels, given));
        }
        Ok(Self {
            taps: OnceLock::new(),
            turned: OnceLock::new(),
            fast: OnceLock::new(),
            filters,
            splines,
            wiring,
        })
    }

    /// The filters `(C, C_in, height, width)`.
    #[must_use]
    pub fn filters(&self) -> ArrayView4<'_, F> {
        self.filters.view()
    }

    pub(super) fn taps(&self) -> &Filters<F> {
        self.taps
            .get_or_init(|| Filters::new(self.filters.view(), self.wiring.stride))
    }

    pub(super) fn fast(&self) -> Option<&Fast<F>> {
        let made = || Fast::new(self.filters.view(), self.wiring.stride);
        self.fast.get_or_init(made).as_ref()
    }

    pub(super) fn turned(&self) -> &Turned<F> {
        self.turned.get_or_init(|| Turned::new(self.filters.view()))
    }

    /// The planes that it gives.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.filters.dim().0 / (self.wiring.upsampling * self.wiring.upsampling)
    }

    /// The pointwise functions, one per channel, or none.
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
    pub(super) fn bend(&self, planes: &mut [F]) {
        let pixels = planes.len() / self.channels();
        for (spline, plane) in self.splines.iter().zip(planes.chunks_exact_mut(pixels)) {
            spline.apply(plane);
        }
    }
}

/// One spline of each row of coefficients.
pub(super) fn splines_of<F: Real>(
    coefficients: ArrayView2<'_, F>,
    start: F,
    spacing: F,
) -> Result<Vec<Spline<F>>> {
    if coefficients.ncols() < 4 {
        let given = coefficients.ncols();
        return Err(Error::range("spline coefficients", "at least 4", given));
    }
    if !coefficients.iter().all(|x| x.is_finite()) {
        let given = "infinity or NaN";
        return Err(Error::range("spline coefficients", "finite numbers", given));
    }
    if !(spacing > F::zero() && spacing.is_finite() && start.is_finite()) {
        return Err(Error::range("knot spacing", "positive", spacing));
    }
    let rows = coefficients.rows().into_iter();
    Ok(rows
        .map(|row| Spline::new(&contiguous(row), start, spacing))
        .collect())
}
