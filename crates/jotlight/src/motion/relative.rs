//! Where the pixels of another segment are that have the same positions in a block of frames.

use ndarray::{ArrayView3, Axis};

use super::columns::Columns;
use super::field::Displacements;
use super::lines::BLOCK;
use super::rounding::round;
use crate::error::Result;

/// How far the pixels of another segment are from those of a segment that have the same positions.
#[derive(Clone, Debug)]
pub struct Relative<'a> {
    displacements: Displacements<'a>,
}

impl<'a> Relative<'a> {
    /// Return the distances of the pixels of an image of `size`, from those at the centers of tiles
    /// `(2, ⌈H/tile⌉, ⌈W/tile⌉)`.
    ///
    /// # Errors
    /// As [`Displacements::new`].
    pub fn new(nodes: ArrayView3<'a, f32>, tile: usize, size: (usize, usize)) -> Result<Self> {
        let fields = nodes.insert_axis(Axis(0));
        Ok(Self {
            displacements: Displacements::new(fields, Some(tile), size.0, size.1)?,
        })
    }

    /// Return the size of the image.
    pub(super) fn size(&self) -> (usize, usize) {
        self.displacements.size()
    }

    /// Return the distances of a row.
    pub(super) fn row(&self, row: usize) -> RelativeRow<'_> {
        let values = [0, 1].map(|direction| {
            let mut values = vec![0.0; self.displacements.padded_length()];
            self.displacements
                .read_row((0, direction), row, &mut values);
            values
        });
        RelativeRow {
            columns: self.displacements.columns(),
            values,
            row,
            size: self.size(),
        }
    }
}

/// The distances of a row of pixels.
pub(super) struct RelativeRow<'a> {
    columns: &'a Columns,
    values: [Vec<f32>; 2],
    row: usize,
    size: (usize, usize),
}

/// The index of a pixel that is outside of the image.
pub(super) const OUTSIDE: usize = usize::MAX;

impl RelativeRow<'_> {
    /// Return the pixels of the other segment that have the positions of a block of [`BLOCK`] pixels.
    /// A pixel is `row * W + column`, or [`OUTSIDE`].
    #[inline(always)]
    pub fn places(&self, block: usize) -> [usize; BLOCK] {
        let (height, width) = self.size;
        let [down, right] = [0, 1].map(|axis| self.columns.pixels(block, &self.values[axis]));
        let mut places = [OUTSIDE; BLOCK];
        for pixel in 0..BLOCK {
            let row = self.row as i32 + round(down[pixel]);
            let column = (BLOCK * block + pixel) as i32 + round(right[pixel]);
            let is_inside = (row as u32 as usize) < height && (column as u32 as usize) < width;
            if is_inside {
                places[pixel] = row as usize * width + column as usize;
            }
        }
        places
    }
}
