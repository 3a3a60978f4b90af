//! Displacements of pixels.

use ndarray::{ArrayView3, ArrayView4, s};

use super::columns::{Columns, interval};
use crate::bits::contiguous;
use crate::error::{Error, Result};

/// The maximum displacement in rows and columns.
const MAX_DISPLACEMENT: f32 = 100_000.0;

/// Displacements that change linearly from each field to the next one.
#[derive(Clone, Debug)]
pub struct Displacements<'a> {
    fields: ArrayView4<'a, f32>,
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
    /// field does not cover `rows` × `columns` pixels, or has displacements that are not finite or
    /// above 100,000 pixels.
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
        if fields.dim().0 == 0 {
            return Err(Error::range("fields of displacements", "at least 1", 0));
        }
        let expected = (fields.dim().0, 2, tiles(rows), tiles(columns));
        if fields.dim() != expected {
            return Err(Error::shape("displacements", expected, fields.dim()));
        }
        for field in fields.outer_iter() {
            check_range(field)?;
        }
        Ok(Self {
            fields,
            tile,
            columns: Columns::new(columns, tile),
        })
    }

    /// Return the columns of pixels.
    pub(super) fn columns(&self) -> &Columns {
        &self.columns
    }

    /// Return the number of fields.
    pub(super) fn number(&self) -> usize {
        self.fields.dim().0
    }

    /// Replace `values` with those of a row of pixels: in rows, then in columns, and each in the
    /// field of an index and in the next one, if there is one.
    ///
    /// They are displacements of tile centers, the last of which is repeated, or of pixels.
    #[inline(always)]
    pub(super) fn read_row(&self, index: usize, row: usize, values: &mut Vec<f32>) {
        values.clear();
        for direction in 0..2 {
            for field in [index, (index + 1).min(self.number() - 1)] {
                let plane = self.fields.slice_move(s![field, direction, .., ..]);
                let Some(tile) = self.tile else {
                    values.extend_from_slice(&contiguous(plane.row(row)));
                    continue;
                };
                let (above, fraction) = interval(row, tile, plane.nrows());
                let below = contiguous(plane.row((above + 1).min(plane.nrows() - 1)));
                let start = values.len();
                values.extend_from_slice(&contiguous(plane.row(above)));
                for (value, below) in values[start..].iter_mut().zip(&*below) {
                    *value += fraction * (below - *value);
                }
                values.push(values[values.len() - 1]);
            }
        }
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
