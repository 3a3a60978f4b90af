//! Short outlines: regions with a large gain inside, and a short boundary.

use ndarray::{ArrayView2, ArrayViewMut2};
use rayon::prelude::*;

use super::rounding::{max, min};
use crate::error::{Error, Result};
use crate::interrupt;

const ITERATIONS: usize = 150;

/// The length of the steps, for a length of outlines that costs 1.
const STEP: f32 = 0.35;

/// Set `out` to the pixels whose gain minus the cost of their outline is largest.
///
/// They are a level set of the minimizer m of `length` Σ |∇m| − Σ gain m with 0 ≤ m ≤ 1 (Chan,
/// Esedoglu, and Nikolova 2006), which a primal-dual method finds (Chambolle and Pock 2011).
///
/// # Errors
/// [`Error::Shape`] if the shapes differ. [`Error::Range`] if the length is not a number above 0.
pub fn shortest_outlines(
    gain: ArrayView2<'_, f32>,
    length: f32,
    mut out: ArrayViewMut2<'_, bool>,
) -> Result<()> {
    if out.dim() != gain.dim() {
        return Err(Error::shape("output", gain.dim(), out.dim()));
    }
    if !(length > 0.0 && length.is_finite()) {
        return Err(Error::range("length", "a number above 0", length));
    }
    if gain.is_empty() {
        return Ok(());
    }
    let width = gain.ncols();
    let (step, dual) = (STEP / length, length / (8.0 * STEP));
    let mut inside: Vec<f32> = gain
        .iter()
        .map(|&gain| if gain > 0.0 { 1.0 } else { 0.0 })
        .collect();
    let gain: Vec<f32> = gain.iter().map(|gain| gain * step).collect();
    let mut ahead = inside.clone();
    let [mut down, mut right] = [0, 1].map(|_| vec![0.0; gain.len()]);
    for _ in 0..ITERATIONS {
        if interrupt::is_requested() {
            return Ok(());
        }
        let rows = down
            .par_chunks_mut(width)
            .zip(right.par_chunks_mut(width))
            .zip(ahead.par_chunks(width))
            .enumerate();
        rows.for_each(|(row, ((down, right), current))| {
            let start = ((row + 1) * width).min(ahead.len() - width);
            let below = &ahead[start..start + width];
            add_differences(down, right, current, below, dual, length);
        });
        let rows = inside
            .par_chunks_mut(width)
            .zip(ahead.par_chunks_mut(width))
            .zip(gain.par_chunks(width))
            .enumerate();
        rows.for_each(|(row, ((inside, ahead), gain))| {
            let part = |row: usize| row * width..(row + 1) * width;
            let above = row.checked_sub(1).map(|row| &down[part(row)]);
            let flow = [&down[part(row)], &right[part(row)]];
            move_inside(inside, ahead, gain, flow, above, step);
        });
    }
    for (out, inside) in out.iter_mut().zip(inside) {
        *out = inside > 0.5;
    }
    Ok(())
}

/// Add the differences of a row to the row below and to the next columns, times `dual`, to the flow.
/// Its magnitude is at most `length`.
fn add_differences(
    down: &mut [f32],
    right: &mut [f32],
    current: &[f32],
    below: &[f32],
    dual: f32,
    length: f32,
) {
    for ((down, current), below) in down.iter_mut().zip(current).zip(below) {
        *down += dual * (below - current);
    }
    for (right, pair) in right.iter_mut().zip(current.windows(2)) {
        *right += dual * (pair[1] - pair[0]);
    }
    for (down, right) in down.iter_mut().zip(right) {
        let excess = max((*down * *down + *right * *right).sqrt() / length, 1.0);
        *down /= excess;
        *right /= excess;
    }
}

/// Move the values of a row along the divergence of the flow and the gain, and extrapolate them.
fn move_inside(
    inside: &mut [f32],
    ahead: &mut [f32],
    gain: &[f32],
    [down, right]: [&[f32]; 2],
    above: Option<&[f32]>,
    step: f32,
) {
    for column in 0..inside.len() {
        let left = if column > 0 { right[column - 1] } else { 0.0 };
        let above = above.map_or(0.0, |above| above[column]);
        let divergence = down[column] + right[column] - above - left;
        let before = inside[column];
        let moved = min(max(before + step * divergence + gain[column], 0.0), 1.0);
        inside[column] = moved;
        ahead[column] = 2.0 * moved - before;
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, s};

    use super::*;

    #[test]
    fn a_square_has_its_outline_and_a_pixel_has_none() -> Result<()> {
        let mut gain = Array2::from_elem((9, 9), -1.0);
        gain.slice_mut(s![2..7, 2..7]).fill(3.0);
        gain[[4, 4]] = -1.0;
        let mut out = Array2::from_elem((9, 9), false);
        shortest_outlines(gain.view(), 1.0, out.view_mut())?;
        let expected = Array2::from_shape_fn((9, 9), |(row, column)| {
            (2..7).contains(&row) && (2..7).contains(&column)
        });
        assert_eq!(out, expected);
        Ok(())
    }

    #[test]
    fn bad_arguments_are_refused() {
        let gain = Array2::zeros((2, 3));
        let mut few = Array2::from_elem((2, 2), false);
        assert!(shortest_outlines(gain.view(), 1.0, few.view_mut()).is_err());
        let mut out = Array2::from_elem((2, 3), false);
        for length in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(shortest_outlines(gain.view(), length, out.view_mut()).is_err());
        }
    }
}
