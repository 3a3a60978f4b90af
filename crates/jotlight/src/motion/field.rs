//! Displacements of pixels.

use std::borrow::Cow;

use ndarray::{ArrayView3, ArrayView4};

use super::columns::{Columns, interval};
use super::lines::{BLOCK, BLOCKS_PER_STEP};
use crate::bits::contiguous;
use crate::error::{Error, Result};

/// The maximum displacement in rows and columns.
const MAX_DISPLACEMENT: f32 = 100_000.0;

/// Displacements that change linearly from each field to the next one.
#[derive(Clone, Debug)]
pub struct Displacements<'a> {
    /// The values of all fields, one after the other.
    fields: Cow<'a, [f32]>,
    /// The height and the width of the image in pixels.
    size: (usize, usize),
    /// The numbers of fields, and of rows and columns of a field.
    number: usize,
    rows: usize,
    row_length: usize,
    tile: Option<usize>,
    columns: Columns,
}

impl<'a> Displacements<'a> {
    /// Return the displacements between one or more fields `(m, 2, rows, columns)`.
    ///
    /// A field has one displacement in rows and columns at the center of each square tile, shape
    /// `(2, ⌈H/tile⌉, ⌈W/tile⌉)`. Between the centers, they are interpolated linearly; beyond them,
    /// extrapolated. If `tile` is `None`, a field has one displacement for each pixel, `(2, H, W)`.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if the width of a tile is 0, there is no field, or a
    /// field does not cover `rows` × `columns` pixels, or has displacements that are infinite, NaN,
    /// or above 100,000 pixels.
    pub fn new(
        fields: ArrayView4<'a, f32>,
        tile: Option<usize>,
        rows: usize,
        columns: usize,
    ) -> Result<Self> {
        let tiles = |length: usize| tile.map_or(length, |tile| length.div_ceil(tile));
        if tile == Some(0) {
            return Err(Error::range("width of a tile", "at least 1", 0));
        }
        let number = fields.dim().0;
        if number == 0 {
            return Err(Error::range("fields of displacements", "at least 1", 0));
        }
        let expected = (number, 2, tiles(rows), tiles(columns));
        if fields.dim() != expected {
            return Err(Error::shape("displacements", expected, fields.dim()));
        }
        for field in fields.outer_iter() {
            check_range(field)?;
        }
        let values = fields.to_slice().map(Cow::Borrowed);
        Ok(Self {
            fields: values.unwrap_or_else(|| fields.iter().copied().collect()),
            size: (rows, columns),
            number,
            rows: tiles(rows),
            row_length: tiles(columns),
            tile,
            columns: Columns::new(columns, tile),
        })
    }

    /// Return the mean displacements over time, given the share of each field.
    pub(super) fn mean(&self, shares: &[f64]) -> Displacements<'static> {
        let mut sum = vec![0.0; self.fields.len() / self.number];
        for (field, share) in self.fields.chunks_exact(sum.len()).zip(shares) {
            for (sum, &value) in sum.iter_mut().zip(field) {
                *sum += *share as f32 * value;
            }
        }
        Displacements {
            fields: Cow::Owned(sum),
            number: 1,
            columns: self.columns.clone(),
            ..*self
        }
    }

    /// Return the height and the width of the image in pixels.
    pub(super) fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Check that the displacements are those of an image of a size.
    pub(super) fn check_size(&self, size: (usize, usize)) -> Result<()> {
        if self.size == size {
            Ok(())
        } else {
            Err(Error::shape("image of the displacements", size, self.size))
        }
    }

    /// Return the columns of pixels.
    pub(super) fn columns(&self) -> &Columns {
        &self.columns
    }

    /// Return the number of fields.
    pub(super) fn number(&self) -> usize {
        self.number
    }

    /// Replace the [`Displacements::padded_length`] values with those of a row of pixels, of a field
    /// and a direction.
    ///
    /// They are displacements of tile centers or of pixels. One value comes before the first one,
    /// and some after the last one. If a block is a tile, the next ones are extrapolated.
    #[inline(always)]
    pub(super) fn read_row(
        &self,
        (field, direction): (usize, usize),
        row: usize,
        values: &mut [f32],
    ) {
        let (above, fraction) = match self.tile {
            Some(tile) => interval(row, tile, self.rows),
            None => (row, 0.0),
        };
        let below = (above + 1).min(self.rows - 1);
        let [above, below] = [above, below].map(|row| {
            let start = ((2 * field + direction) * self.rows + row) * self.row_length;
            &self.fields[start..start + self.row_length]
        });
        let last = self.row_length - 1;
        let (inner, after) = values[1..].split_at_mut(self.row_length);
        for ((value, above), below) in inner.iter_mut().zip(above).zip(below) {
            *value = above + fraction * (below - above);
        }
        // The first and the last value of pixels are repeated.
        let slope = if self.tile.is_none() { 0.0 } else { 1.0 };
        after.fill(inner[last]);
        after[0] += slope * (inner[last] - inner[last.saturating_sub(1)]);
        values[0] = values[1] + slope * (values[1] - values[1 + last.min(1)]);
    }

    /// Return the number of values of a row, with those before and after it.
    pub(super) fn padded_length(&self) -> usize {
        let step = BLOCKS_PER_STEP * if self.tile.is_none() { BLOCK } else { 1 };
        self.row_length.next_multiple_of(step) + 2
    }
}

/// Check that displacements are finite and small.
fn check_range(field: ArrayView3<'_, f32>) -> Result<()> {
    let range = -MAX_DISPLACEMENT..=MAX_DISPLACEMENT;
    for row in field.rows() {
        let row = contiguous(row);
        // The compiler vectorizes this loop, which does not end early.
        if row
            .iter()
            .fold(true, |all, value| all & range.contains(value))
        {
            continue;
        }
        if let Some(value) = row.iter().find(|&value| !range.contains(value)) {
            return Err(Error::range(
                "displacements",
                format!("numbers from -{MAX_DISPLACEMENT} to {MAX_DISPLACEMENT}"),
                value,
            ));
        }
    }
    Ok(())
}
