//! Planes with a mirrored border, and their convolution with the filters of a layer, equation (9).

use std::ops::Range;

use ndarray::{Array3, ArrayView3};

use super::direct::SPARE_ROWS;
use super::filter_taps::{FilterTaps, TapOrder};
use super::{PlanesView, leading_rows};
use crate::border::mirror_index;
use crate::cpu::levels;
use crate::interrupt;
use crate::lanes::MAX_LANES;
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::{PlanesMut, StripedPlanes};
use crate::numbers::Real;

/// The maximum number of columns beyond the last one that a tile of shifts of the tap gradient reads.
const SPARE_COLUMNS: usize = 4;

/// A stack of planes with a mirrored border. The inner loops may read beyond the end of a row.
#[derive(Default)]
pub(crate) struct Padded<F> {
    pub(super) data: Vec<F>,
    pub(super) plane_stride: usize,
    pub(super) row_stride: usize,
    /// The numbers of rows and columns that the convolution returns.
    height: usize,
    width: usize,
    /// The numbers of rows and columns of the filters in each phase.
    pub(super) taps: (usize, usize),
}

impl<F: Real> Padded<F> {
    /// Allocate planes of the size that the filters read, and space for reads beyond their ends.
    pub(super) fn allocate(&mut self, channels: usize, (rows, columns): (usize, usize)) {
        self.row_stride = columns.next_multiple_of(MAX_LANES) + MAX_LANES + SPARE_COLUMNS;
        self.plane_stride = (rows + SPARE_ROWS) * self.row_stride;
        let length = channels * self.plane_stride + MAX_LANES;
        self.data.resize(length, F::zero());
    }

    /// Return a copy of planes `(channels, height, width)` with the border that the filters read.
    pub fn mirrored(planes: ArrayView3<'_, F>, filters: &FilterTaps<F>) -> Self {
        let (_, height, width) = planes.dim();
        let planes = planes.as_standard_layout();
        let planes = planes.as_slice().unwrap_or_default();
        let source = StripedPlanes::contiguous(planes, (height, width));
        let mut padded = Self::default();
        padded.fill(&source, &Region::whole((height, width)), filters);
        padded
    }

    /// Copy the part of `source` that the filters read to compute a region of their output.
    pub fn fill(
        &mut self,
        source: &StripedPlanes<'_, F>,
        output: &Region,
        filters: &FilterTaps<F>,
    ) {
        let stride = filters.stride;
        self.taps = filters.phase_size;
        (self.height, self.width) = (output.rows.len(), output.columns.len());
        let rows = self.height + self.taps.0 - 1;
        let columns = self.width + self.taps.1 - 1;
        self.allocate(filters.inputs * stride * stride, (rows, columns));
        // The first row and column that the filters read, which may lie outside the planes.
        let first = |start: usize, taps: usize| {
            (start * stride) as isize - leading_rows(taps, stride) as isize
        };
        let top = first(output.rows.start, filters.size.0);
        let left = first(output.columns.start, filters.size.1);
        for (plane, out) in self.data.chunks_exact_mut(self.plane_stride).enumerate() {
            let (input, phase) = (plane / (stride * stride), plane % (stride * stride));
            let copy = RowCopy::new(source, left + (phase % stride) as isize, stride, columns);
            for (row, out) in out.chunks_exact_mut(self.row_stride).take(rows).enumerate() {
                let row = top + (row * stride + phase / stride) as isize;
                let row = source.row(mirror_index(row, source.size.0));
                copy.copy(
                    &row.plane(input)[..source.columns.len()],
                    &mut out[..columns],
                );
            }
        }
    }

    /// Return memory for `length` values. It replaces the planes.
    pub fn scratch(&mut self, length: usize) -> &mut [F] {
        self.data.resize(self.data.len().max(length), F::zero());
        &mut self.data[..length]
    }

    pub(super) fn view(&self) -> PlanesView<'_, F> {
        PlanesView {
            data: &self.data,
            plane_stride: self.plane_stride,
            row_stride: self.row_stride,
        }
    }

    /// Write h * u, summed over the input channels, into `out`.
    pub fn convolve(&self, filters: &FilterTaps<F>, out: &mut PlanesMut<'_, F>) {
        match &filters.order {
            TapOrder::OneOutput(filter) => {
                let nonzero = 0..self.height + self.taps.0 - 1;
                filter.correlate(self.view(), nonzero, out);
            }
            TapOrder::ManyOutputs(bank) => bank.correlate(self.view(), out),
        }
    }

    /// Return h * u, summed over the input channels.
    pub fn convolved(&self, filters: &FilterTaps<F>) -> Array3<F> {
        let mut out = Array3::zeros((filters.outputs(), self.height, self.width));
        if let Some(out) = out.as_slice_mut() {
            let size = (self.height, self.width);
            self.convolve(filters, &mut PlanesMut::contiguous(out, size));
        }
        out
    }

    /// Call `visit` with the index of each tap of a filter, and with the plane that the tap
    /// multiplies.
    pub fn for_each_tap(
        &self,
        (channels, rows, columns): (usize, usize, usize),
        mut visit: impl FnMut(usize, &[F]),
    ) {
        let mut plane = Vec::with_capacity(self.height * self.width);
        for index in 0..channels * rows * columns {
            let channel = index / (rows * columns);
            if interrupt::is_requested() {
                return;
            }
            let tap_row = rows - 1 - index / columns % rows;
            let tap_column = columns - 1 - index % columns;
            plane.clear();
            for row in 0..self.height {
                let row_start = (tap_row + row) * self.row_stride + tap_column;
                let start = channel * self.plane_stride + row_start;
                plane.extend_from_slice(&self.data[start..start + self.width]);
            }
            visit(index, &plane);
        }
    }
}

/// The columns of a row that are copied to a phase: every `stride`-th column, and mirrored columns
/// beyond the ends of the row.
struct RowCopy {
    /// The column of the planes for index 0 of the copy. It may lie outside the planes.
    left: isize,
    stride: usize,
    /// The indices of the copy whose columns lie in the source.
    inside: Range<usize>,
    /// The first column of the source.
    first: usize,
    /// The number of columns of the planes.
    width: usize,
}

impl RowCopy {
    fn new<F>(source: &StripedPlanes<'_, F>, left: isize, stride: usize, columns: usize) -> Self {
        let from = (source.columns.start as isize - left).max(0) as usize;
        let start = from.div_ceil(stride).min(columns);
        let to = (source.columns.end as isize - left).max(0) as usize;
        Self {
            left,
            stride,
            inside: start..to.div_ceil(stride).clamp(start, columns),
            first: source.columns.start,
            width: source.size.1,
        }
    }

    fn copy<F: Real>(&self, source: &[F], out: &mut [F]) {
        let inside = self.inside.clone();
        if self.stride == 1 {
            let start = self.left + inside.start as isize - self.first as isize;
            let source = &source[start.max(0) as usize..][..inside.len()];
            out[inside.clone()].copy_from_slice(source);
        } else if self.stride == 2 && !inside.is_empty() {
            copy_every_second(
                &source[self.column(inside.start)..],
                &mut out[inside.clone()],
            );
        } else if !inside.is_empty() {
            let source = source[self.column(inside.start)..].iter();
            let source = source.step_by(self.stride);
            for (out, &value) in out[inside.clone()].iter_mut().zip(source) {
                *out = value;
            }
        }
        for column in (0..inside.start).chain(inside.end..out.len()) {
            out[column] = source[self.column(column)];
        }
    }

    /// Return the index in the source for an index of the copy.
    fn column(&self, column: usize) -> usize {
        let column = self.left + (column * self.stride) as isize;
        mirror_index(column, self.width) - self.first
    }
}

levels! {
    /// Copy every second value of `source`, from the first one on.
    fn copy_every_second[F: Real](source: &[F], out: &mut [F]) = copy_every_second_inlined;
}

#[inline(always)]
fn copy_every_second_inlined<F: Real>(source: &[F], out: &mut [F]) {
    let (pairs, last) = source.as_chunks::<2>();
    let (whole, rest) = out.split_at_mut(pairs.len().min(out.len()));
    for (out, pair) in whole.iter_mut().zip(pairs) {
        *out = pair[0];
    }
    // The last value of a row may have no successor.
    for (out, &value) in rest.iter_mut().zip(last) {
        *out = value;
    }
}
