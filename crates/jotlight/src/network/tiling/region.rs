//! Rectangular regions of pixels.

use std::ops::Range;

/// A rectangular region of pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Region {
    pub rows: Range<usize>,
    pub columns: Range<usize>,
}

impl Region {
    /// Return the region of all pixels of an image.
    pub fn whole((height, width): (usize, usize)) -> Self {
        Self {
            rows: 0..height,
            columns: 0..width,
        }
    }

    /// Return the number of pixels.
    pub fn pixels(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    /// Extend the region to the smallest region that contains it and `other`.
    pub fn include(&mut self, other: &Self) {
        if self.pixels() == 0 {
            *self = other.clone();
            return;
        }
        let hull = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        self.rows = hull(&self.rows, &other.rows);
        self.columns = hull(&self.columns, &other.columns);
    }

    /// Return the region of the planes before an upsampling by `factor`.
    pub fn before_upsampling(&self, factor: usize) -> Self {
        let divided = |range: &Range<usize>| range.start / factor..range.end.div_ceil(factor);
        Self {
            rows: divided(&self.rows),
            columns: divided(&self.columns),
        }
    }

    /// Return the region, extended so that rows and columns begin and end at multiples of `factor`.
    pub fn aligned(&self, factor: usize) -> Self {
        let Self { rows, columns } = self.before_upsampling(factor);
        Self {
            rows: rows.start * factor..rows.end * factor,
            columns: columns.start * factor..columns.end * factor,
        }
    }

    /// Return the region, extended so that rows and columns begin and end at multiples of `side`,
    /// but at most to the end of planes of the size `(height, width)`.
    pub fn with_whole_tiles(&self, side: usize, (height, width): (usize, usize)) -> Self {
        let Self { rows, columns } = self.aligned(side);
        Self {
            rows: rows.start..rows.end.min(height),
            columns: columns.start..columns.end.min(width),
        }
    }
}
