//! A layer of the network: a bank of filters, one spline per channel, and the layer's connections.

use std::sync::OnceLock;

use ndarray::{Array4, ArrayView2, ArrayView4};

use super::convolution::adjoint::AdjointTaps;
use super::convolution::filter_taps::FilterTaps;
use super::convolution::winograd::Winograd;
use super::spline::channels::build_splines;
use super::spline::evaluate::Spline;
use crate::error::{Error, Result};
use crate::numbers::Real;

/// A layer φ(D(h * u) + v) with splines φ, depth-to-space rearrangement D, filters h, input planes
/// u, and skip planes v.
#[derive(Clone, Debug)]
pub struct Layer<F> {
    pub(super) filters: Array4<F>,
    /// The splines of the channels. Empty if the layer is linear.
    pub(super) splines: Vec<Spline<F>>,
    pub(super) wiring: Wiring,
    // The filters in the memory order of the inner loops. Each form is computed when it is first
    // needed, because most networks need only one of them per layer.
    filter_taps: OnceLock<FilterTaps<F>>,
    adjoint_taps: OnceLock<AdjointTaps<F>>,
    winograd: OnceLock<Option<Winograd<F>>>,
}

/// The connections of a layer to the other layers, and its change of resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// The step of the filters along rows and columns of the input.
    pub stride: usize,
    /// The depth-to-space factor r: r² planes become one plane with r times as many rows and
    /// columns.
    pub upsampling: usize,
    /// The index of the layer whose output the filters read. None: the previous layer.
    pub input: Option<usize>,
    /// The index of the layer whose output is added before the splines. None: no skip connection.
    pub skip: Option<usize>,
}

impl Default for Wiring {
    fn default() -> Self {
        Self {
            stride: 1,
            upsampling: 1,
            input: None,
            skip: None,
        }
    }
}

impl<F: Real> Layer<F> {
    /// Return a layer with filters of shape `(outputs, inputs, height, width)`.
    ///
    /// The filters of a first layer have shape `(C, T, K̂, K̂)`, or `(C, 1, 1, 1)` if they are
    /// tied. The spline coefficients have shape `(outputs / upsampling², N_w)` and belong to knots
    /// at `start` + k·`spacing`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the arrays do not fit. [`Error::Range`] for values that are not finite,
    /// fewer than 4 coefficients, a spacing that is not positive, a stride that exceeds the size
    /// of the filters, and an upsampling whose square does not divide the number of outputs.
    pub fn new(
        filters: Array4<F>,
        coefficients: Option<ArrayView2<'_, F>>,
        start: F,
        spacing: F,
        wiring: Wiring,
    ) -> Result<Self> {
        check_filters(filters.view(), wiring)?;
        let channels = filters.dim().0 / (wiring.upsampling * wiring.upsampling);
        let splines = match coefficients {
            None => Vec::new(),
            Some(coefficients) => build_splines(coefficients, start, spacing)?,
        };
        if coefficients.is_some() && splines.len() != channels {
            let rows = splines.len();
            return Err(Error::shape("rows of spline coefficients", channels, rows));
        }
        Ok(Self {
            filters,
            splines,
            wiring,
            filter_taps: OnceLock::new(),
            adjoint_taps: OnceLock::new(),
            winograd: OnceLock::new(),
        })
    }

    /// Return the filters, `(outputs, inputs, height, width)`.
    #[must_use]
    pub fn filters(&self) -> ArrayView4<'_, F> {
        self.filters.view()
    }

    /// Return the number of output planes.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.filters.dim().0 / (self.wiring.upsampling * self.wiring.upsampling)
    }

    /// Return the splines, one per channel, or none if the layer is linear.
    #[must_use]
    pub fn splines(&self) -> &[Spline<F>] {
        &self.splines
    }

    /// Return the number of filter taps and spline coefficients.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.filters.len() + self.splines.iter().map(Spline::len).sum::<usize>()
    }

    /// Apply the splines in place to planes `(C, H, W)`: equations (8) and (10).
    pub(super) fn activate(&self, planes: &mut [F]) {
        let pixels = planes.len() / self.channels();
        for (spline, plane) in self.splines.iter().zip(planes.chunks_exact_mut(pixels)) {
            spline.apply(plane);
        }
    }

    pub(super) fn filter_taps(&self) -> &FilterTaps<F> {
        self.filter_taps
            .get_or_init(|| FilterTaps::new(self.filters.view(), self.wiring.stride))
    }

    pub(super) fn adjoint_taps(&self) -> &AdjointTaps<F> {
        self.adjoint_taps
            .get_or_init(|| AdjointTaps::new(self.filters.view()))
    }

    /// Return the filters for Winograd convolution, or None where direct convolution is faster.
    pub(super) fn winograd(&self) -> Option<&Winograd<F>> {
        self.winograd
            .get_or_init(|| Winograd::new(self.filters.view(), self.wiring.stride))
            .as_ref()
    }
}

/// Check that the filters are finite, and that stride and upsampling fit their shape.
fn check_filters<F: Real>(filters: ArrayView4<'_, F>, wiring: Wiring) -> Result<()> {
    let (outputs, _, height, width) = filters.dim();
    if filters.is_empty() {
        let shape = format!("{:?}", filters.dim());
        return Err(Error::range("filters", "at least one tap", shape));
    }
    if !filters.iter().all(|x| x.is_finite()) {
        return Err(Error::range("filters", "finite values", "infinity or NaN"));
    }
    let Wiring {
        stride, upsampling, ..
    } = wiring;
    if !(1..=height.min(width)).contains(&stride) {
        let expected = "1 to the size of the filters";
        return Err(Error::range("stride", expected, stride));
    }
    if upsampling == 0 || !outputs.is_multiple_of(upsampling * upsampling) {
        let expected = "a number whose square divides the number of filters";
        return Err(Error::range("upsampling", expected, upsampling));
    }
    Ok(())
}
