//! Rounding of real counts such that the errors of neighbors cancel.

use ndarray::{ArrayView2, ArrayViewMut2, Axis};
use rayon::prelude::*;

use crate::bits::contiguous;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// Multiples of it, without their whole parts, are spread evenly over [0, 1).
const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;

/// The smallest and the largest error that the next pixel of a row makes up for.
const ERRORS: (f64, f64) = (-1.0, 1.0);

/// The number of rows that are rounded together. Each number waits for that before it, so several
/// rows take hardly longer than one.
const ROWS: usize = 8;

/// The number of columns that are rounded together.
const COLUMNS: usize = 64;

/// Write whole numbers from 0 into `out` that have about the same sum along each row as the values,
/// `(H, W)`.
///
/// The error of a pixel is added to the next pixel of its row. So the mean of a region stays right
/// even if all its values are alike, which are all rounded in the same direction otherwise. Rows
/// begin with different errors, so that they make no pattern together. A pixel that is not known
/// becomes 0, and passes its value on.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match.
pub fn diffuse(
    values: ArrayView2<'_, f64>,
    is_known: ArrayView2<'_, bool>,
    mut out: ArrayViewMut2<'_, f64>,
) -> Result<()> {
    for (what, shape) in [("known pixels", is_known.dim()), ("out", out.dim())] {
        if shape != values.dim() {
            return Err(Error::shape(what, values.dim(), shape));
        }
    }
    out.axis_chunks_iter_mut(Axis(0), ROWS)
        .into_par_iter()
        .enumerate()
        .for_each(|(task, out)| round_rows(task * ROWS, values, is_known, out));
    Ok(())
}

/// Round at most [`ROWS`] rows, of which `first` is the first.
fn round_rows(
    first: usize,
    values: ArrayView2<'_, f64>,
    is_known: ArrayView2<'_, bool>,
    mut out: ArrayViewMut2<'_, f64>,
) {
    let rows = first..first + out.nrows();
    let values: Vec<_> = rows
        .clone()
        .map(|row| contiguous(values.row(row)))
        .collect();
    let is_known: Vec<_> = rows.map(|row| contiguous(is_known.row(row))).collect();
    let mut errors = std::array::from_fn(|row| (first + row) as f64 * GOLDEN_RATIO % 1.0);
    let mut part = [Column::default(); COLUMNS];
    for start in (0..out.ncols()).step_by(COLUMNS) {
        if interrupt::is_requested() {
            return;
        }
        let length = COLUMNS.min(out.ncols() - start);
        let part = &mut part[..length];
        for (row, (values, is_known)) in values.iter().zip(&is_known).enumerate() {
            let pixels = values[start..].iter().zip(&is_known[start..]);
            for (column, (&value, &is_known)) in part.iter_mut().zip(pixels) {
                column.values[row] = value;
                column.is_known[row] = is_known;
            }
        }
        round_columns(part, &mut errors);
        for (row, mut out) in out.rows_mut().into_iter().enumerate() {
            for (out, column) in out.iter_mut().skip(start).zip(&*part) {
                *out = column.values[row];
            }
        }
    }
}

/// The values of a column, or its whole numbers, and which of them are known.
#[derive(Clone, Copy, Default)]
struct Column {
    values: [f64; ROWS],
    is_known: [bool; ROWS],
}

levels! {
    /// Replace the values of columns with whole numbers, and the errors of the rows.
    fn round_columns(columns: &mut [Column], errors: &mut [f64; ROWS]) = round_columns_inlined;
}

#[inline(always)]
fn round_columns_inlined(columns: &mut [Column], errors: &mut [f64; ROWS]) {
    for column in columns {
        for row in 0..ROWS {
            let wanted = column.values[row] + errors[row];
            let floor = wanted.floor();
            // NaN stays NaN.
            let is_zero = !column.is_known[row] || floor < 0.0;
            let whole = if is_zero { 0.0 } else { floor };
            column.values[row] = whole;
            errors[row] = (wanted - whole).clamp(ERRORS.0, ERRORS.1);
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, s};

    use super::*;
    use crate::threads::install;

    /// Return the whole numbers of one pixel after the other.
    fn naive(values: &Array2<f64>, is_known: &Array2<bool>) -> Array2<f64> {
        let mut whole = Array2::zeros(values.dim());
        for row in 0..values.nrows() {
            let mut error = (row as f64 * GOLDEN_RATIO) % 1.0;
            for column in 0..values.ncols() {
                let wanted = values[[row, column]] + error;
                if is_known[[row, column]] {
                    whole[[row, column]] = wanted.floor().max(0.0);
                }
                error = (wanted - whole[[row, column]]).clamp(-1.0, 1.0);
            }
        }
        whole
    }

    #[test]
    fn rows_are_rounded_one_pixel_after_the_other() -> Result<()> {
        for shape in [(0, 3), (3, 0), (1, 1), (8, 64), (7, 65), (21, 200)] {
            let mix = |row: usize, column: usize| (row * 7919 + column * 104_729) % 1009;
            let values =
                Array2::from_shape_fn(shape, |(row, column)| mix(row, column) as f64 / 300.0 - 1.0);
            let is_known = values.mapv(|value| value < 2.1);
            let expected = naive(&values, &is_known);
            for threads in [1, 2, 5] {
                let mut out = Array2::from_elem(shape, f64::NAN);
                let place = out.view_mut();
                install(Some(threads), || {
                    diffuse(values.view(), is_known.view(), place)
                })??;
                assert_eq!(out, expected);
            }
            // The order in memory does not matter.
            let (values, is_known) = (values.t().to_owned(), is_known.t().to_owned());
            let mut out = Array2::zeros((shape.1, shape.0));
            diffuse(values.t(), is_known.t(), out.view_mut().reversed_axes())?;
            assert_eq!(out.t(), expected);
        }
        Ok(())
    }

    #[test]
    fn a_value_that_is_nan_ends_a_row_alone() -> Result<()> {
        let mut values = Array2::from_elem((3, 5), 1.5);
        values[[1, 2]] = f64::NAN;
        let is_known = Array2::from_elem((3, 5), true);
        let mut out = Array2::zeros((3, 5));
        diffuse(values.view(), is_known.view(), out.view_mut())?;
        assert!(out.slice(s![1, 2..]).iter().all(|value| value.is_nan()));
        assert_eq!(out.iter().filter(|value| value.is_nan()).count(), 3);
        Ok(())
    }

    #[test]
    fn other_shapes_are_refused() {
        let (values, known) = (Array2::zeros((2, 3)), Array2::from_elem((2, 3), true));
        let mut wide = Array2::zeros((2, 4));
        let result = diffuse(values.view(), known.view(), wide.view_mut());
        assert!(matches!(result, Err(Error::Shape { what: "out", .. })));
        let known = Array2::from_elem((3, 2), true);
        let result = diffuse(
            values.view(),
            known.view(),
            Array2::zeros((2, 3)).view_mut(),
        );
        assert!(matches!(
            result,
            Err(Error::Shape {
                what: "known pixels",
                ..
            })
        ));
    }
}
