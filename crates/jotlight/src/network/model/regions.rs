//! Parts of an image that together contain the pixels of a map.

use std::ops::Range;

use ndarray::{Array2, ArrayView2, ArrayViewMut2, Axis, Zip, s};

/// The side of the cells of which regions consist, in pixels.
const CELL: usize = 8;

/// The maximum number of rows of cells between which an image is divided into bands.
const MAX_ROWS: usize = 32;

/// The time that a network takes for each row of an image, in units of that for a pixel.
const ROW_COST: usize = 64;

/// Neighboring rows of an image, of which only some runs of columns are needed.
///
/// The parts of an image around these runs are denoised side by side, as one image. Each needed
/// pixel lies at least a halo away from the border of a part, unless the image ends there.
#[derive(Debug, PartialEq)]
pub(super) struct Band {
    /// The needed rows.
    pub rows: Range<usize>,
    /// The rows, with a halo above and below.
    pub wide_rows: Range<usize>,
    /// The columns of the parts.
    pub runs: Vec<Range<usize>>,
}

impl Band {
    /// Return the values of `map` for the parts of an image, side by side.
    pub fn cut(&self, image: ArrayView2<'_, f32>, map: impl Fn(f32) -> f32) -> Array2<f32> {
        let width = self.runs.iter().map(ExactSizeIterator::len).sum();
        let mut parts = Array2::zeros((self.wide_rows.len(), width));
        let mut left = 0;
        for run in &self.runs {
            let place = parts.slice_mut(s![.., left..left + run.len()]);
            let source = image.slice(s![self.wide_rows.clone(), run.clone()]);
            Zip::from(place)
                .and(source)
                .for_each(|part, &value| *part = map(value));
            left += run.len();
        }
        parts
    }

    /// Add the needed rows of each part to their places in an image, times weights.
    pub fn add(
        &self,
        parts: ArrayView2<'_, f32>,
        weights: ArrayView2<'_, f32>,
        mut image: ArrayViewMut2<'_, f32>,
    ) {
        let (top, mut left) = (self.rows.start - self.wide_rows.start, 0);
        for run in &self.runs {
            let columns = left..left + run.len();
            let values = parts.slice(s![top..top + self.rows.len(), columns]);
            let place = s![self.rows.clone(), run.clone()];
            Zip::from(image.slice_mut(place))
                .and(weights.slice(place))
                .and(values)
                .for_each(|sum, &weight, &value| *sum += weight * value);
            left += run.len();
        }
    }
}

/// Return bands of an image, one below the other, that contain all pixels with a weight above 0.
///
/// They are those for which a network takes the least time: each of them costs halos, but bands with
/// few rows leave out more columns. `halo` is the number of pixels around a needed one on which it
/// depends.
pub(super) fn cover(weights: ArrayView2<'_, f32>, halo: usize) -> Vec<Band> {
    let (height, width) = weights.dim();
    // Whether a row of a cell has a needed pixel.
    let mut needed = Array2::from_elem((height, width.div_ceil(CELL)), false);
    for (row, mut cells) in weights.rows().into_iter().zip(needed.rows_mut()) {
        let parts = row.axis_chunks_iter(Axis(0), CELL);
        for (part, need) in parts.into_iter().zip(&mut cells) {
            *need = part.iter().any(|&weight| weight > 0.0);
        }
    }
    // Whether a row of cells has one, for rows of 8 pixels.
    let rows: Vec<bool> = (0..height.div_ceil(CELL))
        .map(|row| {
            let rows = row * CELL..((row + 1) * CELL).min(height);
            needed.slice(s![rows, ..]).iter().any(|&need| need)
        })
        .collect();
    let side = height.div_ceil(MAX_ROWS * CELL).max(1);
    let step = side * CELL;
    let shape = (height.div_ceil(step), needed.ncols());
    let cells = Array2::from_shape_fn(shape, |(row, cell)| {
        let rows = row * step..((row + 1) * step).min(height);
        needed.slice(s![rows, cell]).iter().any(|&need| need)
    });
    let bands = divide(&cells, step, halo, (height, width)).into_iter();
    bands
        .filter_map(|Range { start, end }| {
            let part = side * start..(side * end).min(rows.len());
            let first = part.start + rows[part.clone()].iter().position(|&need| need)?;
            let last = part.start + rows[part].iter().rposition(|&need| need)?;
            let rows = CELL * first..(CELL * (last + 1)).min(height);
            Some(Band {
                wide_rows: widen(&rows, halo, height),
                rows,
                runs: runs(&cells, start..end, halo, width),
            })
        })
        .collect()
}

/// Return the rows of cells of each band that has needed cells.
fn divide(
    cells: &Array2<bool>,
    step: usize,
    halo: usize,
    (height, width): (usize, usize),
) -> Vec<Range<usize>> {
    let number = cells.nrows();
    // The least time for all rows from one on, and the end of the first band then.
    let (mut least, mut ends) = (vec![0; number + 1], vec![0; number]);
    for first in (0..number).rev() {
        let widths = widths(cells, first, halo, width);
        let start = (first * step).saturating_sub(halo);
        let times = widths.into_iter().enumerate().map(|(offset, width)| {
            let end = first + offset + 1;
            let rows = (end * step + halo).min(height) - start;
            let time = if width > 0 {
                rows * (ROW_COST + width)
            } else {
                0
            };
            (time + least[end], end)
        });
        // Of bands that take the same time, the first one.
        (least[first], ends[first]) = times.min_by_key(|&(time, _)| time).unwrap_or((0, number));
    }
    let (mut bands, mut first) = (Vec::new(), 0);
    while first < number {
        let band = first..ends[first];
        if cells.slice(s![band.clone(), ..]).iter().any(|&need| need) {
            bands.push(band.clone());
        }
        first = band.end;
    }
    bands
}

/// Return about how many columns the parts have of bands from the row `first` to each other one.
///
/// They are 0 for bands without needed cells.
fn widths(cells: &Array2<bool>, first: usize, halo: usize, width: usize) -> Vec<usize> {
    let reach = halo.div_ceil(CELL);
    let mut near = vec![false; cells.ncols()];
    let rows = cells.rows().into_iter().skip(first);
    rows.map(|row| {
        for (cell, _) in row.iter().enumerate().filter(|&(_, &need)| need) {
            let last = (cell + reach + 1).min(near.len());
            near[cell.saturating_sub(reach)..last].fill(true);
        }
        (CELL * near.iter().filter(|&&near| near).count()).min(width)
    })
    .collect()
}

/// Return the columns around needed cells of some rows. Runs that would overlap are one run.
fn runs(cells: &Array2<bool>, rows: Range<usize>, halo: usize, width: usize) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for cell in 0..cells.ncols() {
        if !cells.slice(s![rows.clone(), cell]).iter().any(|&need| need) {
            continue;
        }
        let run = widen(&(CELL * cell..(CELL * (cell + 1)).min(width)), halo, width);
        match runs.last_mut() {
            Some(last) if last.end >= run.start => last.end = run.end,
            _ => runs.push(run),
        }
    }
    runs
}

/// Return rows or columns with the halo on both sides of them that lies in the image.
fn widen(part: &Range<usize>, halo: usize, length: usize) -> Range<usize> {
    part.start.saturating_sub(halo)..(part.end + halo).min(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(height: usize, width: usize, need: impl Fn(usize, usize) -> bool) -> Array2<f32> {
        Array2::from_shape_fn(
            (height, width),
            |(row, column)| {
                if need(row, column) { 0.5 } else { 0.0 }
            },
        )
    }

    fn band(rows: Range<usize>, wide_rows: Range<usize>, runs: &[(usize, usize)]) -> Band {
        Band {
            rows,
            wide_rows,
            runs: runs.iter().map(|&(start, end)| start..end).collect(),
        }
    }

    /// Return a whole number below 10⁶ that looks random.
    fn hash(a: usize, b: usize, c: usize) -> usize {
        let mut value = (a as u64) << 42 ^ (b as u64) << 21 ^ c as u64;
        for _ in 0..3 {
            value = (value ^ value >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        }
        (value >> 20) as usize % 1_000_000
    }

    #[test]
    fn bands_contain_all_needed_pixels_once_with_their_halos() {
        for seed in 0..60 {
            let (height, width) = (1 + hash(seed, 1, 0) % 300, 1 + hash(seed, 2, 0) % 200);
            let density = [0, 300, 3000, 100_000, 1_000_000][seed % 5];
            let halo = [0, 3, 40][seed % 3];
            let weights = map(height, width, |row, column| {
                hash(seed, row, column + 1) < density
            });
            let columns = Array2::from_shape_fn((height, width), |(_, column)| column as f32 + 1.0);
            let mut sums = Array2::<f32>::zeros((height, width));
            for band in cover(weights.view(), halo) {
                let parts = band.cut(columns.view(), |x| x);
                assert!(parts.ncols() <= width);
                let rows = widen(&band.rows, halo, height);
                assert_eq!(
                    (rows.clone(), parts.nrows()),
                    (band.wide_rows.clone(), rows.len())
                );
                for run in &band.runs {
                    let near = weights.slice(s![band.rows.clone(), run.clone()]);
                    let is_needed =
                        |column: &usize| near.column(*column - run.start).iter().any(|&x| x > 0.0);
                    let needed: Vec<usize> = run.clone().filter(is_needed).collect();
                    for column in needed {
                        let wide = widen(&(column..column + 1), halo, width);
                        assert!(run.start <= wide.start && wide.end <= run.end);
                    }
                }
                let ones = Array2::ones((height, width));
                band.add(parts.view(), ones.view(), sums.view_mut());
            }
            for ((place, &sum), &weight) in sums.indexed_iter().zip(&weights) {
                let expected = place.1 as f32 + 1.0;
                assert!((sum - expected).abs() < 0.5 || (sum < 0.5 && weight <= 0.0));
            }
        }
    }

    #[test]
    fn the_sides_of_a_border_are_denoised_side_by_side() {
        let inside = |place: usize| (5..315).contains(&place);
        let needed = map(320, 320, |row, column| !(inside(row) && inside(column)));
        let expected = [
            band(0..16, 0..24, &[(0, 320)]),
            band(16..304, 8..312, &[(0, 16), (304, 320)]),
            band(304..320, 296..320, &[(0, 320)]),
        ];
        assert_eq!(cover(needed.view(), 8), expected);
    }

    #[test]
    fn a_corner_is_a_region_of_its_own() {
        let needed = map(96, 128, |row, column| row < 20 && column < 20);
        assert_eq!(cover(needed.view(), 30), [band(0..24, 0..54, &[(0, 54)])]);
    }

    /// Separate bands would have more halos.
    #[test]
    fn scattered_pixels_share_a_band() {
        let needed = map(320, 320, |row, column| {
            row < 64 && column < 64 && row % 16 == 0 && column % 16 == 0
        });
        assert_eq!(cover(needed.view(), 8), [band(0..56, 0..64, &[(0, 64)])]);
    }

    #[test]
    fn distant_pixels_have_bands_of_their_own() {
        let needed = map(320, 320, |row, column| {
            [(3, 5), (300, 250)].contains(&(row, column))
        });
        let expected = [
            band(0..8, 0..16, &[(0, 16)]),
            band(296..304, 288..312, &[(240, 264)]),
        ];
        assert_eq!(cover(needed.view(), 8), expected);
    }

    #[test]
    fn columns_far_apart_are_side_by_side() {
        let needed = map(100, 300, |row, column| {
            row < 40 && ((70..80).contains(&column) || column >= 280)
        });
        let expected = [band(0..40, 0..44, &[(60, 84), (276, 300)])];
        assert_eq!(cover(needed.view(), 4), expected);
    }
}
