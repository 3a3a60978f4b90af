//! Where planes are: rectangles of pixels, and planes in strips of rows.

use std::ops::Range;

/// A rectangle of pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Place {
    pub rows: Range<usize>,
    pub columns: Range<usize>,
}

impl Place {
    pub fn pixels(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    /// The least place that has both.
    pub fn include(&mut self, other: &Self) {
        if self.pixels() == 0 {
            *self = other.clone();
            return;
        }
        let hull = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        self.rows = hull(&self.rows, &other.rows);
        self.columns = hull(&self.columns, &other.columns);
    }

    /// The rows and columns of which these are made by an upsampling.
    pub fn divided(&self, up: usize) -> Self {
        let divided = |range: &Range<usize>| range.start / up..range.end.div_ceil(up);
        Self {
            rows: divided(&self.rows),
            columns: divided(&self.columns),
        }
    }

    /// With all rows of each group of so many that it has some of, up to the last row of all.
    pub fn with_rows(&self, group: usize, rows: usize) -> Self {
        let end = self.rows.end.next_multiple_of(group).min(rows);
        Self {
            rows: self.rows.start / group * group..end,
            columns: self.columns.clone(),
        }
    }

    /// The rows and columns that are made of those.
    pub fn aligned(&self, up: usize) -> Self {
        let Self { rows, columns } = self.divided(up);
        Self {
            rows: rows.start * up..rows.end * up,
            columns: columns.start * up..columns.end * up,
        }
    }
}

/// Some rows of a stack of planes, `(channels, rows, columns)`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Strip<D> {
    pub rows: Range<usize>,
    pub data: D,
}

/// Part of a stack of planes, in strips one below the other.
pub(crate) struct Part<'a, F> {
    pub strips: Vec<Strip<&'a [F]>>,
    pub columns: Range<usize>,
    /// Of all planes.
    pub size: (usize, usize),
}

impl<'a, F> Part<'a, F> {
    /// In one strip.
    pub fn whole(planes: &'a [F], place: Place, size: (usize, usize)) -> Self {
        let strip = Strip {
            rows: place.rows,
            data: planes,
        };
        Self {
            strips: vec![strip],
            columns: place.columns,
            size,
        }
    }

    /// One of the rows of the planes, which it has.
    pub fn row(&self, row: usize) -> Row<'a, F> {
        let above = self.strips.partition_point(|strip| strip.rows.end <= row);
        let Strip { rows, data } = &self.strips[above];
        let width = self.columns.len();
        Row {
            strip: data,
            start: (row - rows.start) * width,
            plane: rows.len() * width,
        }
    }
}

/// A row of every plane of a strip.
#[derive(Clone, Copy)]
pub(crate) struct Row<'a, F> {
    strip: &'a [F],
    /// Where that of the first plane starts, and from one plane to the next.
    start: usize,
    plane: usize,
}

impl<'a, F> Row<'a, F> {
    /// Of a plane, and on to the end of the strip.
    pub fn of(&self, plane: usize) -> &'a [F] {
        &self.strip[self.start + plane * self.plane..]
    }
}
