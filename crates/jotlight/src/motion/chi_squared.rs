//! A χ² test of whether the counts of a block of frames agree with a template.

use ndarray::{ArrayView2, ArrayViewMut1, ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::boxes::{
    LastRows, add_neighbors, add_three, add_variances, squared_ratio, sums_at_borders,
    weights_of_variances,
};
use super::brightness::{RARE, add_parts, brightness_of_blocks};
use super::count::{Count, Counts};
use super::template::SHARE_OF_TEMPLATE;
use crate::bits::contiguous;
use crate::border::{mirror_index, reflect_margins};
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// The number of rows that one task computes.
pub(super) const ROWS_PER_TASK: usize = 64;

/// The number of pixels that χ² reads in each direction: 1 for the squares of side 3, and 4 for those
/// of side 9.
const RADIUS: usize = 5;

/// Counts of a block of frames, and the template to which they are compared.
#[derive(Clone, Copy, Debug)]
pub struct Comparison<'a, C = i32> {
    /// The counts of the parts of the block, which are added.
    pub parts: &'a [Counts<'a, C>],
    /// p, the probability of a one at each pixel of the template, `(H, W)`.
    pub probability: ArrayView2<'a, f32>,
    /// D_R, the number of trials of each pixel of the template, `(H, W)`.
    pub trials_of_template: ArrayView2<'a, i32>,
}

/// Write χ² of each pixel into `out`. It is about 1 if the counts agree with the template.
///
/// N, D, and D p are the counts with a few more ones and zeros, 0.02 each. The residual counts
/// N/β − D p and their variances D p(1 − p)(1 + 0.35 D/D_R) are added in squares of 3 × 3 pixels. A pixel
/// that a square contains m times, because the image is reflected, adds m² times its variance. The
/// ratio of the squared residual to the variance is averaged over the pixels with trials in a square
/// of 9 × 9 pixels, and over one more pixel whose ratio is 1. β is the brightness of the block, the ratio of
/// Σ N to Σ D p.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the image is
/// empty, a probability is not above 0 and below 1, or counts are not possible.
pub fn chi_squared<C: Count>(
    comparison: &Comparison<'_, C>,
    mut out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    let Comparison {
        parts,
        probability,
        trials_of_template,
    } = *comparison;
    let size = probability.dim();
    let brightness = brightness_of_blocks(&[parts], probability, trials_of_template)?;
    let per_one = 1.0 / brightness[0] as f32;
    if out.dim() != size {
        return Err(Error::shape("output", size, out.dim()));
    }
    out.axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK)
        .into_par_iter()
        .enumerate()
        .for_each(|(band, out)| {
            if !interrupt::is_requested() {
                test_band(comparison, per_one, band * ROWS_PER_TASK, out);
            }
        });
    Ok(())
}

levels! {
    /// Compute χ² of some rows, of which `first` is the first.
    pub(super) fn test_band[C: Count](
        comparison: &Comparison<'_, C>, per_one: f32, first: usize, out: ArrayViewMut2<'_, f32>,
    ) = test_band_inlined;
}

#[inline(always)]
fn test_band_inlined<C: Count>(
    comparison: &Comparison<'_, C>,
    per_one: f32,
    first: usize,
    mut out: ArrayViewMut2<'_, f32>,
) {
    let (rows, width) = out.dim();
    // A reflected image has the same sums as the reflected sums of the image. So it is extended
    // once, by all pixels that a square of squares reads.
    let extended = width + 2 * RADIUS;
    // Only the last rows are kept, which stay in the fastest cache.
    let mut counts = [(); 2].map(|()| vec![0.0; width]);
    let mut terms = [(); 2].map(|()| vec![0.0; extended]);
    let mut counted = LastRows::<3>::new(extended);
    let mut sums = [(); 2].map(|()| LastRows::<3>::new(extended - 2));
    let mut ratios = vec![0.0; extended - 2];
    let mut triples = vec![0.0; extended - 4];
    let mut averages = [(); 2].map(|()| LastRows::<3>::new(width));
    let mut large = [(); 2].map(|()| LastRows::<7>::new(width));
    let height = comparison.probability.nrows();
    let at_borders = sums_at_borders(RADIUS, width);
    for index in 0..rows + 2 * RADIUS {
        let place = (first + index) as isize - RADIUS as isize;
        let row = mirror_index(place, height);
        add_parts(comparison.parts, row, &mut counts);
        let known = counted.row_mut(index);
        compare_row(comparison, per_one, row, &counts, &mut terms, known);
        add_neighbors(&terms[0], 1, sums[0].row_mut(index));
        add_variances(&terms[1], &at_borders, sums[1].row_mut(index));
        // Each sum ends with the newest row that it needs.
        let Some(index) = index.checked_sub(2) else {
            continue;
        };
        let known = &counted.row(index + 1)[1..][..extended - 2];
        let [residuals, variances] = sums
            .each_ref()
            .map(|sums| [0, 1, 2].map(|k| sums.row(index + k)));
        let weights = weights_of_variances(place - 2, height);
        divide(residuals, (variances, weights), known, &mut ratios);
        for (source, averages) in [&ratios[..], known].into_iter().zip(&mut averages) {
            add_neighbors(source, 1, &mut triples);
            add_neighbors(&triples, 3, averages.row_mut(index));
        }
        let Some(index) = index.checked_sub(2) else {
            continue;
        };
        for (averages, large) in averages.iter().zip(&mut large) {
            let rows = [0, 1, 2].map(|k| averages.row(index + k));
            add_three(rows, large.row_mut(index));
        }
        let Some(index) = index.checked_sub(6) else {
            continue;
        };
        let [ratios, numbers] = large
            .each_ref()
            .map(|large| [0, 3, 6].map(|k| large.row(index + k)));
        write_averages(ratios, numbers, out.row_mut(index));
    }
}

/// Write the results of [`average`] into a row of an image.
#[inline(always)]
fn write_averages(ratios: [&[f32]; 3], numbers: [&[f32]; 3], mut out: ArrayViewMut1<'_, f32>) {
    if let Some(out) = out.as_slice_mut() {
        return average(ratios, numbers, out);
    }
    let mut row = vec![0.0; out.len()];
    average(ratios, numbers, &mut row);
    out.iter_mut()
        .zip(row)
        .for_each(|(out, value)| *out = value);
}

/// Divide the squared sums of three rows of residuals by the weighted sums of their variances.
#[inline(always)]
fn divide(
    residuals: [&[f32]; 3],
    (variances, weights): ([&[f32]; 3], [f32; 3]),
    known: &[f32],
    ratios: &mut [f32],
) {
    let length = ratios.len();
    let [residuals, variances] = [residuals, variances].map(|rows| rows.map(|row| &row[..length]));
    let known = &known[..length];
    for i in 0..length {
        let residual = residuals[0][i] + (residuals[1][i] + residuals[2][i]);
        let variance = weights[0] * variances[0][i]
            + (weights[1] * variances[1][i] + weights[2] * variances[2][i]);
        ratios[i] = squared_ratio(residual, variance) * known[i];
    }
}

/// Write the averages of the ratios in three rows of sums, with one more ratio of 1, into `out`.
#[inline(always)]
fn average(ratios: [&[f32]; 3], numbers: [&[f32]; 3], out: &mut [f32]) {
    let [ratios, numbers] = [ratios, numbers].map(|rows| rows.map(|row| &row[..out.len()]));
    for i in 0..out.len() {
        let ratio = ratios[0][i] + (ratios[1][i] + ratios[2][i]);
        let number = numbers[0][i] + (numbers[1][i] + numbers[2][i]);
        out[i] = (ratio + 1.0) / (number + 1.0);
    }
}

/// Compute the residuals, their variances, and whether there are trials, of a row of pixels.
#[inline(always)]
fn compare_row<C: Count>(
    comparison: &Comparison<'_, C>,
    per_one: f32,
    row: usize,
    [ones, trials]: &[Vec<f32>; 2],
    [residuals, variances]: &mut [Vec<f32>; 2],
    counted: &mut [f32],
) {
    let width = ones.len();
    let inner = RADIUS..RADIUS + width;
    let p = contiguous(comparison.probability.row(row));
    let of_template = contiguous(comparison.trials_of_template.row(row));
    let residual = residuals[inner.clone()].iter_mut().zip(ones.iter());
    for ((residual, &ones), (&trials, &p)) in residual.zip(trials.iter().zip(p.iter())) {
        let added = if trials > 0.0 { RARE } else { 0.0 };
        *residual = (ones + added) * per_one - (trials * p + added);
    }
    let variance = variances[inner.clone()].iter_mut().zip(trials.iter());
    for ((variance, &trials), (&p, &of_template)) in variance.zip(p.iter().zip(of_template.iter()))
    {
        let added = if trials > 0.0 { RARE } else { 0.0 };
        let (ones, zeros) = (trials * p + added, trials * (1.0 - p) + added);
        let all = ones + zeros;
        let share = SHARE_OF_TEMPLATE * all / of_template.max(1) as f32;
        let known = if all > 0.0 { all } else { 1.0 };
        *variance = ones * (zeros / known) * (1.0 + share);
    }
    for (counted, &trials) in counted[inner].iter_mut().zip(trials.iter()) {
        *counted = if trials > 0.0 { 1.0 } else { 0.0 };
    }
    for row in [residuals, variances, counted] {
        reflect_margins(row, RADIUS, width);
    }
}
