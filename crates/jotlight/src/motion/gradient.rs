//! Derivatives of images along rows and columns.

use ndarray::{ArrayView2, ArrayView3, ArrayViewMut2, Axis, s};
use rayon::prelude::*;

use super::lines::BLOCK;
use super::sums::check_remainders;
use crate::bits::contiguous;
use crate::border::{mirror_index, reflect_margins};
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::filter::{LANES, Rows, filter};
use crate::interrupt;

/// The taps of the derivative, exact for polynomials of degree 6.
///
/// Rounding shifts the scene by up to half a pixel. Differences of direct neighbors underestimate
/// the slopes of fine details by a fifth, and so the effect of this shift.
const DERIVATIVE: [f32; 7] = [
    -1.0 / 60.0,
    3.0 / 20.0,
    -3.0 / 4.0,
    0.0,
    3.0 / 4.0,
    -3.0 / 20.0,
    1.0 / 60.0,
];

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

/// Write probabilities into `out` after their pixels are moved by the mean remainders r̄, to first
/// order: p − r̄ · ∇p, from `least` to 1 − `least`.
///
/// `remainders` `(H, 2, ⌈W/BLOCK⌉)` holds sums over a number of frames, as
/// [`super::count_shifted`] computes them.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the image is
/// empty, a value is not finite, or `least` is not from 0 to 0.5.
pub fn undo_remainders(
    image: ArrayView2<'_, f32>,
    remainders: ArrayView3<'_, f32>,
    frames: usize,
    least: f64,
    mut out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    let (height, width) = image.dim();
    check_finite(image)?;
    check_remainders(remainders, image.dim())?;
    if out.dim() != image.dim() {
        return Err(Error::shape("output", image.dim(), out.dim()));
    }
    if !(0.0..=0.5).contains(&least) {
        return Err(Error::range("least probability", "0 to 0.5", least));
    }
    let limits = (least as f32, (1.0 - least) as f32);
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
            let row = mirror_index((first + index) as isize - RADIUS as isize, height);
            near[..width].copy_from_slice(&contiguous(image.row(row)));
        }
        let mut gradient = [(); 2].map(|()| vec![0.0; rows * stride]);
        let [along_rows, along_columns] = &mut gradient;
        differentiate(&near, along_rows, along_columns, width);
        let mut moved = vec![0.0; width];
        for (index, mut out) in out.rows_mut().into_iter().enumerate() {
            let slopes = gradient
                .each_ref()
                .map(|plane| &plane[index * stride..][..width]);
            let means = [0, 1].map(|k| {
                let remainders = remainders.slice(s![first + index, k, ..]);
                remainders.iter().map(|sum| per_frame * sum).collect()
            });
            let p = &near[(index + RADIUS) * stride..][..width];
            move_row(p, slopes, &means, limits, &mut moved);
            out.iter_mut()
                .zip(&moved)
                .for_each(|(out, &value)| *out = value);
        }
    });
    Ok(())
}

/// Check that an image has pixels, and that they are finite.
fn check_finite(image: ArrayView2<'_, f32>) -> Result<()> {
    if image.is_empty() {
        let received = format!("{:?}", image.dim());
        return Err(Error::range("size", "at least one pixel", received));
    }
    // Without an early end in a row, the compiler vectorizes the search.
    let is_wrong = |row: usize| {
        let row = contiguous(image.row(row));
        row.iter()
            .fold(false, |any, value| any | !value.is_finite())
    };
    let rows = (0..image.nrows()).into_par_iter();
    let Some(row) = rows.find_first(|&row| is_wrong(row)) else {
        return Ok(());
    };
    let row = image.row(row);
    let wrong = row.iter().find(|value| !value.is_finite());
    let value = wrong.copied().unwrap_or_default();
    Err(Error::range("probabilities", "finite numbers", value))
}

levels! {
    /// Move the pixels of a row by the mean remainders of its blocks.
    fn move_row(
        p: &[f32], slopes: [&[f32]; 2], means: &[Vec<f32>; 2], limits: (f32, f32), out: &mut [f32],
    ) = move_row_inlined;
}

#[inline(always)]
fn move_row_inlined(
    p: &[f32],
    slopes: [&[f32]; 2],
    means: &[Vec<f32>; 2],
    (low, high): (f32, f32),
    out: &mut [f32],
) {
    let (blocks, rest) = out.as_chunks_mut::<BLOCK>();
    let number = blocks.len();
    let planes = [p, slopes[0], slopes[1]];
    let move_pixels = |out: &mut [f32], [p, rows, columns]: [&[f32]; 3], block: usize| {
        let mean = [means[0][block], means[1][block]];
        for i in 0..out.len() {
            let moved = p[i] - mean[0] * rows[i] - mean[1] * columns[i];
            let moved = if moved > low { moved } else { low };
            out[i] = if moved < high { moved } else { high };
        }
    };
    for (block, out) in blocks.iter_mut().enumerate() {
        let part = planes.map(|plane| &plane[block * BLOCK..][..BLOCK]);
        move_pixels(out, part, block);
    }
    let part = planes.map(|plane| &plane[number * BLOCK..][..rest.len()]);
    if !rest.is_empty() {
        move_pixels(rest, part, number);
    }
}
