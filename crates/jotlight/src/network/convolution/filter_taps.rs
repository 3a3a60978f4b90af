//! The taps of a layer's filters in the order in which the inner loops read them, and the region of
//! the input that the filters read.

use std::ops::Range;

use ndarray::ArrayView4;

use super::channel_bank::ChannelBank;
use super::direct::FilterTiles;
use super::{PlanesView, leading_rows};
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::{PlanesMut, StripedPlanes};
use crate::numbers::Real;

/// The taps of filters `(outputs, inputs, height, width)`, reversed along rows and columns.
///
/// The reversal turns the convolution into a correlation, which reads its input forward.
///
/// If the stride s is above 1, a polyphase decomposition divides every input plane into s² planes,
/// its phases. The filters then read s² times as many planes, without a stride.
#[derive(Clone, Debug)]
pub(crate) struct FilterTaps<F> {
    pub(super) order: TapOrder<F>,
    pub(super) inputs: usize,
    /// The numbers of rows and columns of a filter.
    pub(super) size: (usize, usize),
    /// The numbers of rows and columns of a filter in each phase.
    pub(super) phase_size: (usize, usize),
    pub(super) stride: usize,
}

/// The order of the taps, which depends on the number of outputs.
#[derive(Clone, Debug)]
pub(super) enum TapOrder<F> {
    OneOutput(FilterTiles<F>),
    ManyOutputs(ChannelBank<F>),
}

impl<F: Real> FilterTaps<F> {
    pub fn new(filters: ArrayView4<'_, F>, stride: usize) -> Self {
        let (outputs, inputs, height, width) = filters.dim();
        let phase_size = (height.div_ceil(stride), width.div_ceil(stride));
        let reversed = |output: usize, input: usize, row: usize, column: usize| {
            filters[[output, input, height - 1 - row, width - 1 - column]]
        };
        let order = if outputs == 1 && stride == 1 {
            let shape = (inputs, height, width);
            TapOrder::OneOutput(FilterTiles::new(shape, |input, row, column| {
                reversed(0, input, row, column)
            }))
        } else {
            let phases = stride * stride;
            let shape = (outputs, inputs * phases, phase_size.0, phase_size.1);
            let tap = |output, plane: usize, row: usize, column: usize| {
                let phase = plane % phases;
                let row = row * stride + phase / stride;
                let column = column * stride + phase % stride;
                if row < height && column < width {
                    reversed(output, plane / phases, row, column)
                } else {
                    F::zero()
                }
            };
            TapOrder::ManyOutputs(ChannelBank::new(shape, tap))
        };
        Self {
            order,
            inputs,
            size: (height, width),
            phase_size,
            stride,
        }
    }

    /// Return whether every filter reads a single value in each phase. An output row then needs no
    /// rows that another output row also needs.
    pub fn is_pointwise(&self) -> bool {
        self.phase_size == (1, 1)
    }

    /// Write the output of filters of 1 × 1 taps for one row, without a copy of their input. Return
    /// false for other filters.
    pub fn correlate_row(
        &self,
        source: &StripedPlanes<'_, F>,
        output: &Region,
        out: &mut PlanesMut<'_, F>,
    ) -> bool {
        let (TapOrder::ManyOutputs(bank), (1, 1), 1) = (&self.order, self.size, self.stride) else {
            return false;
        };
        let row = source.row(output.rows.start);
        let source = PlanesView {
            data: &row.plane(0)[output.columns.start - source.columns.start..],
            plane_stride: row.plane_stride,
            row_stride: 0,
        };
        bank.correlate(source, out);
        true
    }

    /// Return the number of output planes.
    pub fn outputs(&self) -> usize {
        match &self.order {
            TapOrder::OneOutput(_) => 1,
            TapOrder::ManyOutputs(bank) => bank.outputs(),
        }
    }
}

/// Return the region of the input that filters of size `(rows, columns)` read for a region of their
/// output. `(height, width)` is the size of the input.
pub(crate) fn input_region(
    (rows, columns): (usize, usize),
    stride: usize,
    output: &Region,
    (height, width): (usize, usize),
) -> Region {
    let read = |output: &Range<usize>, taps: usize, size: usize| {
        let leading = leading_rows(taps, stride);
        // The loops read whole strides. The taps beyond the end of a filter are 0.
        let end = (output.end.max(1) - 1 + taps.div_ceil(stride)) * stride;
        (output.start * stride).saturating_sub(leading)..end.saturating_sub(leading).min(size)
    };
    Region {
        rows: read(&output.rows, rows, height),
        columns: read(&output.columns, columns, width),
    }
}
