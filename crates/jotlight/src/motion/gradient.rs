//! Derivatives of images along rows and columns.

use ndarray::{ArrayView1, ArrayView2, ArrayView3, ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::filter::{DERIVATIVE, LANES, Rows, filter, reflect, reflect_margins, values};
use super::shifted_counts::BLOCK;
use super::sums::check_remainders;
use crate::error::{Error, Result};
use crate::interrupt;

/// The number of rows before and after a row that its derivatives read.
pub(super) const RADIUS: usize = DERIVATIVE.len() / 2;

/// The number of rows that one task computes.
const ROWS_PER_TASK: usize = 16;

/// Write the derivatives of rows of an image with `width` columns, which are padded to a multiple
/// of [`LANES`] values.
///
/// `source` holds these rows, and [`RADIUS`] rows before and after them.
pub(super) fn differentiate(
    source: &[f32],
    along_rows: &mut [f32],
    along_columns: &mut [f32],
    width: usize,
) {
    let stride = width.next_multiple_of(LANES);
    let vertical = Rows::new(along_rows, stride);
    filter(
        Rows::new(source, stride),
        stride,
        &DERIVATIVE,
        vertical,
        stride,
    );
    let middle = source[RADIUS * stride..].chunks_exact(stride);
    let mut padded = vec![0.0; stride + 2 * RADIUS];
    for (values, out) in middle.zip(along_columns.chunks_exact_mut(stride)) {
        padded[RADIUS..][..width].copy_from_slice(&values[..width]);
        reflect_margins(&mut padded, RADIUS, width);
        let (source, out) = (Rows::new(&padded[..], 0), Rows::new(out, stride));
        filter(source, 1, &DERIVATIVE, out, stride);
    }
}

/// Write an image into `out` after its pixels are moved by the mean remainders r̄, to first order:
/// p − r̄ · ∇p.
///
/// `remainders` `(H, 2, ⌈W/BLOCK⌉)` holds sums over a number of frames, as
/// [`super::add_shifted_counts`] computes them.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the image is
/// empty, or a value is not finite.
pub fn undo_remainders(
    image: ArrayView2<'_, f32>,
    remainders: ArrayView3<'_, f32>,
    frames: usize,
    mut out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    let (height, width) = image.dim();
    if image.is_empty() {
        let received = format!("{:?}", image.dim());
        return Err(Error::range("size", "at least one pixel", received));
    }
    // Without an early end in a row, the compiler vectorizes the search.
    let is_wrong = |row: ArrayView1<'_, f32>| {
        let row = values(row);
        row.iter()
            .fold(false, |any, value| any | !value.is_finite())
    };
    if let Some(row) = image.rows().into_iter().find(|row| is_wrong(*row)) {
        let wrong = row.iter().find(|value| !value.is_finite());
        let value = wrong.copied().unwrap_or_default();
        return Err(Error::range("probabilities", "finite numbers", value));
    }
    check_remainders(remainders, image.dim())?;
    if out.dim() != image.dim() {
        return Err(Error::shape("output", image.dim(), out.dim()));
    }
    let stride = width.next_multiple_of(LANES);
    let per_frame = 1.0 / frames.max(1) as f32;
    let bands = out
        .axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK)
        .into_par_iter();
    bands.enumerate().for_each(|(band, mut out)| {
        if interrupt::is_requested() {
            return;
        }
        let (first, rows) = (band * ROWS_PER_TASK, out.nrows());
        let mut near = vec![0.0; (rows + 2 * RADIUS) * stride];
        for (index, near) in near.chunks_exact_mut(stride).enumerate() {
            let row = reflect((first + index) as isize - RADIUS as isize, height);
            near[..width].copy_from_slice(&values(image.row(row)));
        }
        let mut gradient = [(); 2].map(|()| vec![0.0; rows * stride]);
        let [along_rows, along_columns] = &mut gradient;
        differentiate(&near, along_rows, along_columns, width);
        for (index, mut out) in out.rows_mut().into_iter().enumerate() {
            let remainders = remainders.index_axis(Axis(0), first + index);
            let slopes = gradient
                .each_ref()
                .map(|plane| &plane[index * stride..][..width]);
            let p = &near[(index + RADIUS) * stride..][..width];
            for (column, out) in out.iter_mut().enumerate() {
                let mean = [0, 1].map(|k| per_frame * remainders[[k, column / BLOCK]]);
                *out = p[column] - mean[0] * slopes[0][column] - mean[1] * slopes[1][column];
            }
        }
    });
    Ok(())
}
