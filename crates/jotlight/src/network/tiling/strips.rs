//! Stacks of planes in memory, divided into horizontal strips that lie one below the other.

use std::borrow::Cow;
use std::ops::Range;

use ndarray::{ArrayView, Dimension};

use super::region::Region;
use crate::error::Result;
use crate::memory;

/// A strip: a range of rows of a stack of planes, `(channels, rows, columns)`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Strip<D> {
    pub rows: Range<usize>,
    pub data: D,
}

/// The strips of a layer's output that are in memory.
pub(super) struct LayerBuffer<F> {
    pub strips: Vec<Strip<Vec<F>>>,
    pub columns: Range<usize>,
}

impl<F> LayerBuffer<F> {
    /// Return a view of the strips. `size` is the size of the whole planes.
    pub fn view(&self, size: (usize, usize)) -> StripedPlanes<'_, F> {
        let strips = self.strips.iter().map(|strip| Strip {
            rows: strip.rows.clone(),
            data: &strip.data[..],
        });
        StripedPlanes {
            strips: strips.collect(),
            columns: self.columns.clone(),
            size,
        }
    }
}

/// A view of a region of a stack of planes.
pub(crate) struct StripedPlanes<'a, F> {
    strips: Vec<Strip<&'a [F]>>,
    pub columns: Range<usize>,
    /// The numbers of rows and columns of the whole planes.
    pub size: (usize, usize),
}

impl<'a, F> StripedPlanes<'a, F> {
    /// Return a view of planes that are a single strip.
    pub fn single(planes: &'a [F], region: Region, size: (usize, usize)) -> Self {
        let strip = Strip {
            rows: region.rows,
            data: planes,
        };
        Self {
            strips: vec![strip],
            columns: region.columns,
            size,
        }
    }

    /// Return a row of all planes. The row must lie in a strip.
    pub fn row(&self, row: usize) -> PlaneRow<'a, F> {
        let index = self.strips.partition_point(|strip| strip.rows.end <= row);
        let Strip { rows, data } = &self.strips[index];
        let width = self.columns.len();
        PlaneRow {
            strip: data,
            start: (row - rows.start) * width,
            plane_stride: rows.len() * width,
        }
    }
}

/// The same row of all planes of a strip.
#[derive(Clone, Copy)]
pub(crate) struct PlaneRow<'a, F> {
    strip: &'a [F],
    /// The index of the row in the first plane of the strip.
    start: usize,
    /// The distance in memory from one plane to the next.
    plane_stride: usize,
}

impl<'a, F> PlaneRow<'a, F> {
    /// Return the values from the start of this row in a plane to the end of the strip.
    pub fn plane(&self, plane: usize) -> &'a [F] {
        &self.strip[self.start + plane * self.plane_stride..]
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
