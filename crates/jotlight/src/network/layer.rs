//! A layer of the network: a bank of filters, one spline per channel, and its connections to other
//! layers.

use ndarray::{Array4, ArrayView2, ArrayView4};
use once_cell::race::OnceBox;

use super::convolution::adjoint::AdjointTaps;
use super::convolution::filter_taps::FilterTaps;
use super::convolution::tiles::{self, TileFilters};
use super::convolution::winograd::{self, Winograd};
use super::precision::{Rounding, round_all, round_filters};
use super::spline::channels::build_splines;
use super::spline::evaluate::Spline;
use super::tiling::strips::PlanesMut;
use crate::error::{Error, Result};
use crate::numbers::Real;

/// A layer, which computes φ(D(h * u) + v).
///
/// The input planes u are convolved with the filters h. The depth-to-space rearrangement D
/// increases the resolution. The planes v of a skip connection are added. The splines φ are applied
/// to the sum. D, v, and φ are optional.
#[derive(Clone, Debug)]
pub struct Layer<F> {
    pub(super) filters: Array4<F>,
    /// One spline per channel, or none if the layer is linear.
    pub(super) splines: Vec<Spline<F>>,
    pub(super) wiring: Wiring,
    pub(super) rounding: Rounding,
    // Copies of the filters in the order in which the inner loops read them. Each copy is computed
    // when it is first needed, because a layer usually needs only one of them. Two threads may both
    // compute it, but none waits for another: after a fork, a child process could wait forever.
    filter_taps: OnceBox<FilterTaps<F>>,
    adjoint_taps: OnceBox<AdjointTaps<F>>,
    winograd: OnceBox<Option<Winograd<F>>>,
    tiles: OnceBox<Option<TileFilters>>,
}

/// The connections of a layer to other layers, and its change of resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// The number of input rows per output row of the filters, and of input columns per output
    /// column.
    pub stride: usize,
    /// The factor r of the depth-to-space rearrangement. It turns r² planes into one plane with r
    /// times as many rows and columns.
    pub upsampling: usize,
    /// The index of the layer whose output the filters read, or `None` for the previous layer.
    pub input: Option<usize>,
    /// The index of the layer whose output is added before the splines, or `None` without a skip
    /// connection.
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
    /// Return a layer with filters of the shape `(outputs, inputs, height, width)`.
    ///
    /// The filters of a first layer have the shape `(C, T, K̂, K̂)`, or `(C, 1, 1, 1)` if they are
    /// tied. The spline coefficients have the shape `(outputs / upsampling², N_w)`. The spline
    /// knots are at `start` + k·`spacing`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] for a value that
    /// is not finite, fewer than 4 coefficients per channel, a spacing that is not positive, a
    /// stride that exceeds the size of the filters, or an upsampling whose square does not divide
    /// the number of outputs.
    pub fn new(
        filters: Array4<F>,
        coefficients: Option<ArrayView2<'_, F>>,
        start: F,
        spacing: F,
        wiring: Wiring,
    ) -> Result<Self> {
        let channels = check_filters(filters.view(), wiring)?;
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
            rounding: Rounding::default(),
            filter_taps: OnceBox::new(),
            adjoint_taps: OnceBox::new(),
            winograd: OnceBox::new(),
            tiles: OnceBox::new(),
        })
    }

    /// Return the filters `(outputs, inputs, height, width)`.
    #[must_use]
    pub fn filters(&self) -> ArrayView4<'_, F> {
        self.filters.view()
    }

    /// Return whether this first layer is tied: each filter has one tap for all jots of a pixel.
    pub(super) fn is_tied(&self) -> bool {
        let (_, frames, height, width) = self.filters.dim();
        (frames, height, width) == (1, 1, 1)
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

    /// Return the number of multiplications of the filters per position of their output.
    ///
    /// Winograd's algorithm needs fewer than one per tap.
    #[must_use]
    pub fn multiplications(&self) -> f64 {
        let taps = self.filters.len() as f64;
        self.winograd().map_or(taps, |_| taps * winograd::SHARE)
    }

    /// Apply the splines in place, equations (8) and (10), and round the output if the layer does.
    pub(super) fn activate(&self, planes: &mut PlanesMut<'_, F>) {
        for row in 0..planes.height {
            for plane in 0..self.channels() {
                let values = planes.row(plane, row);
                if let Some(spline) = self.splines.get(plane) {
                    spline.apply(values);
                }
                if self.rounding.output {
                    round_all(values);
                }
            }
        }
    }

    pub(super) fn filter_taps(&self) -> &FilterTaps<F> {
        self.filter_taps
            .get_or_init(|| Box::new(FilterTaps::new(self.filters.view(), self.wiring.stride)))
    }

    pub(super) fn adjoint_taps(&self) -> &AdjointTaps<F> {
        self.adjoint_taps
            .get_or_init(|| Box::new(AdjointTaps::new(self.filters.view())))
    }

    /// Return the filters for products of tiles in bfloat16, or None for other layers, and where the
    /// processor has no such products.
    pub(super) fn tiles(&self) -> Option<&TileFilters> {
        if !(self.rounding.filters && tiles::are_available()) {
            return None;
        }
        self.tiles
            .get_or_init(|| Box::new(TileFilters::new(self.filters.view(), self.wiring.stride)))
            .as_ref()
    }

    /// Return the number of rows of the output that are computed together. It is also the number of
    /// columns.
    pub(super) fn tile_side(&self) -> usize {
        let is_winograd = self.tiles().is_none() && self.winograd().is_some();
        let side = if is_winograd { winograd::TILE } else { 1 };
        side * self.wiring.upsampling
    }

    /// Return the filters for Winograd convolution, or None where direct convolution is faster.
    pub(super) fn winograd(&self) -> Option<&Winograd<F>> {
        self.winograd
            .get_or_init(|| Box::new(Winograd::new(self.filters.view(), self.wiring.stride)))
            .as_ref()
    }
}

impl Layer<f32> {
    /// Return the layer with filters and an output that are rounded to bfloat16.
    pub(super) fn rounded(mut self, rounding: Rounding) -> Self {
        if rounding.filters {
            round_filters(&mut self.filters);
        }
        Self {
            filters: self.filters,
            splines: self.splines,
            wiring: self.wiring,
            rounding,
            filter_taps: OnceBox::new(),
            adjoint_taps: OnceBox::new(),
            winograd: OnceBox::new(),
            tiles: OnceBox::new(),
        }
    }
}

/// Return the number of output planes. Check that the filters are finite, and that their shape
/// permits the stride and the upsampling.
fn check_filters<F: Real>(filters: ArrayView4<'_, F>, wiring: Wiring) -> Result<usize> {
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
    let planes = upsampling.checked_mul(upsampling);
    let Some(planes) = planes.filter(|&planes| planes > 0 && outputs.is_multiple_of(planes)) else {
        let expected = "a number whose square divides the number of filters";
        return Err(Error::range("upsampling", expected, upsampling));
    };
    Ok(outputs / planes)
}
