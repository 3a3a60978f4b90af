//! Displacements of pixels, and their interpolation in space.

use ndarray::{ArrayView3, s};

use crate::error::{Error, Result};

/// The maximum displacement in rows and columns.
const MAX_DISPLACEMENT: f32 = 100_000.0;

/// Displacements at one time, in rows and columns.
#[derive(Clone, Copy, Debug)]
pub enum Field<'a> {
    /// One displacement at the center of each square tile, `(2, rows, columns)` of tiles. Between
    /// the centers, they are interpolated linearly; beyond them, extrapolated.
    Tiles {
        /// The displacements of the centers.
        nodes: ArrayView3<'a, f32>,
        /// The width of a tile in pixels.
        tile: usize,
    },
    /// One displacement for each pixel, `(2, H, W)`.
    Pixels(ArrayView3<'a, f32>),
}

impl<'a> Field<'a> {
    fn values(&self) -> ArrayView3<'a, f32> {
        match *self {
            Self::Tiles { nodes, .. } => nodes,
            Self::Pixels(values) => values,
        }
    }

    /// Check that the field covers an image, and that its displacements are finite and small.
    fn check(&self, rows: usize, columns: usize) -> Result<()> {
        let expected = match *self {
            Self::Pixels(_) => (2, rows, columns),
            Self::Tiles { tile: 0, .. } => {
                return Err(Error::range("width of a tile", "at least 1", 0));
            }
            Self::Tiles { tile, .. } => (2, rows.div_ceil(tile), columns.div_ceil(tile)),
        };
        let values = self.values();
        if values.dim() != expected {
            return Err(Error::shape("displacements", expected, values.dim()));
        }
        let range = -MAX_DISPLACEMENT..=MAX_DISPLACEMENT;
        let is_wrong = |value: &&f32| !range.contains(*value);
        match values.iter().find(is_wrong) {
            Some(value) => Err(Error::range(
                "displacements",
                format!("numbers from -{MAX_DISPLACEMENT} to {MAX_DISPLACEMENT}"),
                value,
            )),
            None => Ok(()),
        }
    }

    /// Return the displacements of a row of pixels in one direction: 0 for rows, 1 for columns.
    fn row(&self, direction: usize, row: usize, columns: usize) -> Vec<f32> {
        let plane = self.values().slice_move(s![direction, .., ..]);
        let Self::Tiles { tile, .. } = *self else {
            return plane.row(row).to_vec();
        };
        let (above, fraction) = interval(row, tile, plane.nrows());
        let below = (above + 1).min(plane.nrows() - 1);
        let pairs = plane.row(above).into_iter().zip(plane.row(below));
        let samples: Vec<f32> = pairs.map(|(&a, &b)| a + fraction * (b - a)).collect();
        let displacement = |column| {
            let (left, fraction) = interval(column, tile, samples.len());
            let right = (left + 1).min(samples.len() - 1);
            samples[left] + fraction * (samples[right] - samples[left])
        };
        (0..columns).map(displacement).collect()
    }
}

/// Return the interval of a pixel between the centers of `tiles` tiles, and its place in it.
///
/// The place is from 0 to 1, or beyond for the pixels before the first and after the last center.
fn interval(pixel: usize, tile: usize, tiles: usize) -> (usize, f32) {
    let index = (pixel.saturating_sub(tile / 2) / tile).min(tiles.saturating_sub(2));
    let center = (tile * index) as f32 + (tile - 1) as f32 / 2.0;
    (index, (pixel as f32 - center) / tile as f32)
}

/// Displacements that change linearly between two times.
#[derive(Clone, Copy, Debug)]
pub struct Displacements<'a> {
    first: Field<'a>,
    last: Field<'a>,
    columns: usize,
}

impl<'a> Displacements<'a> {
    /// Return the displacements between two fields.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if a field does not cover `rows` × `columns` pixels,
    /// or has displacements that are not finite or above 100,000 pixels.
    pub fn new(first: Field<'a>, last: Field<'a>, rows: usize, columns: usize) -> Result<Self> {
        first.check(rows, columns)?;
        last.check(rows, columns)?;
        Ok(Self {
            first,
            last,
            columns,
        })
    }

    /// Return the displacements of a row of pixels at the first time, and their change until the
    /// last one, in both directions.
    pub(super) fn row(&self, row: usize) -> [[Vec<f32>; 2]; 2] {
        let first = [0, 1].map(|direction| self.first.row(direction, row, self.columns));
        let mut change = [0, 1].map(|direction| self.last.row(direction, row, self.columns));
        for (change, first) in change.iter_mut().zip(&first) {
            for (change, first) in change.iter_mut().zip(first) {
                *change -= first;
            }
        }
        [first, change]
    }
}
