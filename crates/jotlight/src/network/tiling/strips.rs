//! Stacks of planes in memory, divided into horizontal strips that lie one below the other.

use std::borrow::Cow;
use std::ops::Range;

use ndarray::{ArrayView, Dimension};

use super::region::Region;
use crate::error::Result;
use crate::lanes::MAX_LANES;
use crate::memory;

/// The number of values to which rows are aligned: a cache line of `f32`. A register that two cache
/// lines share takes twice as long to read.
pub(crate) const LINE: usize = MAX_LANES;

/// A strip: a range of rows of a stack of planes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Strip<D> {
    pub rows: Range<usize>,
    pub data: D,
}

/// The positions of a region of a layer's output in memory. Its order is row, channel, column, so
/// that the rows of many channels that a filter reads are few contiguous parts of the memory.
///
/// Column 0 of the planes, and every column whose number is a multiple of [`LINE`], begins a cache
/// line. At least [`LINE`] values precede and follow each row, so that loops may read beyond it.
#[derive(Clone, Debug)]
pub(crate) struct RowLayout {
    pub columns: Range<usize>,
    channels: usize,
    /// The number of values before the first column of a row.
    lead: usize,
    /// The distance in memory from one channel of a row to the next.
    row_length: usize,
}

impl RowLayout {
    pub fn new(columns: Range<usize>, channels: usize) -> Self {
        let lead = LINE + columns.start % LINE;
        Self {
            channels,
            lead,
            row_length: (lead + columns.len()).next_multiple_of(LINE),
            columns,
        }
    }

    /// Return the number of values in the memory of `rows` rows.
    pub fn length(&self, rows: usize) -> usize {
        // Loops read up to three registers beyond the last row, and the memory may begin within a
        // cache line.
        rows * self.channels * self.row_length + 4 * LINE
    }

    /// Return the memory of a strip for writing. Its length must be [`RowLayout::length`].
    pub fn planes_mut<'a, F>(&self, strip: &'a mut Strip<Vec<F>>) -> PlanesMut<'a, F> {
        let start = line_start(&strip.data) + self.lead;
        PlanesMut {
            data: &mut strip.data[start..],
            plane_stride: self.row_length,
            row_stride: self.channels * self.row_length,
            height: strip.rows.len(),
            width: self.columns.len(),
        }
    }
}

/// Return the index of the first value that begins a cache line.
pub(crate) fn line_start<F>(values: &[F]) -> usize {
    values
        .as_ptr()
        .align_offset(LINE * size_of::<F>())
        .min(LINE)
}

/// The strips of a layer's output that are in memory.
pub(super) struct LayerBuffer<F> {
    pub strips: Vec<Strip<Vec<F>>>,
    pub layout: RowLayout,
}

impl<F> LayerBuffer<F> {
    /// Return a view of the strips. `size` is the size of the whole planes.
    pub fn view(&self, size: (usize, usize)) -> StripedPlanes<'_, F> {
        StripedPlanes::new(&self.strips, &self.layout, size)
    }
}

/// A view of a region of a stack of planes.
pub(crate) struct StripedPlanes<'a, F> {
    strips: Vec<Strip<&'a [F]>>,
    pub columns: Range<usize>,
    /// The numbers of rows and columns of the whole planes.
    pub size: (usize, usize),
    /// The number of values before the first column of a row that may be read.
    lead: usize,
    plane_stride: usize,
    row_stride: usize,
}

impl<'a, F> StripedPlanes<'a, F> {
    /// Return a view of strips. `size` is the size of the whole planes.
    pub fn new(strips: &'a [Strip<Vec<F>>], layout: &RowLayout, size: (usize, usize)) -> Self {
        let strips = strips.iter().map(|strip| Strip {
            rows: strip.rows.clone(),
            data: &strip.data[line_start(&strip.data)..],
        });
        Self {
            strips: strips.collect(),
            columns: layout.columns.clone(),
            size,
            lead: layout.lead,
            plane_stride: layout.row_length,
            row_stride: layout.channels * layout.row_length,
        }
    }

    /// Return a view of planes `(channels, rows, columns)` without values around the rows.
    pub fn contiguous(planes: &'a [F], size: (usize, usize)) -> Self {
        let whole = Region::whole(size);
        let strip = Strip {
            rows: whole.rows,
            data: planes,
        };
        Self {
            strips: vec![strip],
            columns: whole.columns,
            size,
            lead: 0,
            plane_stride: size.0 * size.1,
            row_stride: size.1,
        }
    }

    /// Return a row of all planes. The row must lie in a strip.
    pub fn row(&self, row: usize) -> PlaneRow<'a, F> {
        let index = self.strips.partition_point(|strip| strip.rows.end <= row);
        let Strip { rows, data } = &self.strips[index];
        PlaneRow {
            data: &data[(row - rows.start) * self.row_stride..],
            lead: self.lead,
            plane_stride: self.plane_stride,
        }
    }
}

/// The same row of all planes of a strip.
#[derive(Clone, Copy)]
pub(crate) struct PlaneRow<'a, F> {
    /// The values from those before the row in the first plane to the end of the strip.
    data: &'a [F],
    lead: usize,
    /// The distance in memory from one plane to the next.
    pub plane_stride: usize,
}

impl<'a, F> PlaneRow<'a, F> {
    /// Return the values from the start of this row in a plane to the end of the strip.
    #[inline(always)]
    pub fn plane(&self, plane: usize) -> &'a [F] {
        &self.data[plane * self.plane_stride + self.lead..]
    }

    /// Return the same, but begin at most [`MAX_LANES`] values before the row. The second result is
    /// the index of the row's first value.
    #[inline(always)]
    pub fn plane_and_lead(&self, plane: usize) -> (&'a [F], usize) {
        (&self.data[plane * self.plane_stride..], self.lead)
    }
}

/// The memory of a region of a stack of planes, for writing.
pub(crate) struct PlanesMut<'a, F> {
    /// The values from the first one of the region on.
    data: &'a mut [F],
    plane_stride: usize,
    row_stride: usize,
    pub height: usize,
    pub width: usize,
}

impl<'a, F> PlanesMut<'a, F> {
    /// Return planes `(channels, height, width)` without values around the rows.
    pub fn contiguous(data: &'a mut [F], (height, width): (usize, usize)) -> Self {
        Self {
            data,
            plane_stride: height * width,
            row_stride: width,
            height,
            width,
        }
    }

    /// Return a row of a plane.
    #[inline(always)]
    pub fn row(&mut self, plane: usize, row: usize) -> &mut [F] {
        let start = plane * self.plane_stride + row * self.row_stride;
        &mut self.data[start..start + self.width]
    }

    /// Return the values from a row of a plane to the end of the memory.
    #[inline(always)]
    pub fn row_to_end(&mut self, plane: usize, row: usize) -> &mut [F] {
        &mut self.data[plane * self.plane_stride + row * self.row_stride..]
    }

    /// Return the part from the row `row` on that has `height` rows.
    pub fn rows(&mut self, row: usize, height: usize) -> PlanesMut<'_, F> {
        PlanesMut {
            data: &mut self.data[row * self.row_stride..],
            height,
            ..*self
        }
    }
}

/// Return planes as a slice in row-major order. Planes that are not contiguous are copied.
///
/// # Errors
/// [`crate::error::Error::Memory`] if the memory for the copy is not available.
pub(crate) fn contiguous_planes<'a, T: Copy, D: Dimension>(
    what: &'static str,
    planes: ArrayView<'a, T, D>,
) -> Result<Cow<'a, [T]>> {
    if let Some(planes) = planes.to_slice() {
        return Ok(Cow::Borrowed(planes));
    }
    memory::check::<T>(what, planes.shape())?;
    Ok(Cow::Owned(planes.iter().copied().collect()))
}
