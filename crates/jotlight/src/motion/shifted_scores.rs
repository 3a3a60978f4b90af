//! Peaks of the sums of shifted scores.

use ndarray::{ArrayView2, ArrayView3, Axis};
use rayon::prelude::*;

use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;
use crate::memory;

/// The largest sum of scores, and its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// The sum.
    pub score: f32,
    /// The row and the column of the sum.
    pub place: (usize, usize),
}

/// Return the peak of the sum of scores for each row of shifts.
///
/// `scores` of n windows are `(n, h, w)`, and `shifts` are `(k, n, 2)`. The sum k at a place adds
/// the scores of each window at this place plus its shift in rows and columns. Scores outside are 0.
/// Of several places with the same sum, the first one in row-major order is the peak.
///
/// # Errors
/// [`Error::Shape`] if the shapes do not match, or there are no scores. [`Error::Range`] for scores
/// that are not finite. [`Error::Memory`] if the memory for a sum is not available.
pub fn peak_of_shifted_scores(
    scores: ArrayView3<'_, f32>,
    shifts: ArrayView3<'_, i64>,
) -> Result<Vec<Peak>> {
    let (number, height, width) = scores.dim();
    if height == 0 || width == 0 {
        let expected = format_args!("at least one row and one column");
        return Err(Error::shape("scores", expected, scores.dim()));
    }
    let expected = (shifts.dim().0, number, 2);
    if shifts.dim() != expected {
        return Err(Error::shape("shifts", expected, shifts.dim()));
    }
    if let Some(score) = scores.iter().find(|score| !score.is_finite()) {
        return Err(Error::range("scores", "finite numbers", score));
    }
    memory::check::<f32>("sums of scores", &[height, width])?;
    let scores = scores.as_standard_layout();
    let scores = scores.as_slice().unwrap_or_default();
    Ok(shifts
        .axis_iter(Axis(0))
        .into_par_iter()
        .map_init(
            || vec![0.0; height * width],
            |total, shifts| {
                if !interrupt::is_requested() {
                    add_shifted(scores, shifts, (height, width), total);
                }
                peak(total, width)
            },
        )
        .collect())
}

/// Return the first indices of the scores and of the sum, and the number of those that overlap.
fn overlap(shift: i64, length: usize) -> ((usize, usize), usize) {
    let distance = usize::try_from(shift.unsigned_abs()).map_or(length, |n| n.min(length));
    let first = if shift > 0 {
        (distance, 0)
    } else {
        (0, distance)
    };
    // Without an overlap, both indices must be valid.
    if distance == length {
        return ((0, 0), 0);
    }
    (first, length - distance)
}

fn peak(total: &[f32], width: usize) -> Peak {
    let mut best = (total[0], 0);
    for (index, &score) in total.iter().enumerate() {
        if score > best.0 {
            best = (score, index);
        }
    }
    Peak {
        score: best.0,
        place: (best.1 / width, best.1 % width),
    }
}

levels! {
    /// Replace `total` with the sum of scores for one row of shifts.
    fn add_shifted(
        scores: &[f32], shifts: ArrayView2<'_, i64>, size: (usize, usize), total: &mut [f32],
    ) = add_shifted_inlined;
}

#[inline(always)]
fn add_shifted_inlined(
    scores: &[f32],
    shifts: ArrayView2<'_, i64>,
    (height, width): (usize, usize),
    total: &mut [f32],
) {
    total.fill(0.0);
    for (scores, shift) in scores.chunks_exact(height * width).zip(shifts.rows()) {
        let (top, rows) = overlap(shift[0], height);
        let (left, columns) = overlap(shift[1], width);
        for row in 0..rows {
            let source = &scores[(top.0 + row) * width + left.0..][..columns];
            let target = &mut total[(top.1 + row) * width + left.1..][..columns];
            for (sum, &value) in target.iter_mut().zip(source) {
                *sum += value;
            }
        }
    }
}
