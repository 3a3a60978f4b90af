//! A χ² test of whether the counts of a block of frames agree with a template.

use ndarray::{ArrayView2, ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::boxes::{add_neighbors, add_rows};
use super::brightness::brightness;
use super::count::Count;
use super::filter::{reflect, reflect_margins, values};
use super::sums::check_counts;
use super::template::{SHARE_OF_TEMPLATE, check_template};
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// The number of rows that one task computes.
const ROWS_PER_TASK: usize = 32;

/// The number of pixels that χ² reads in each direction: 1 for the small, and 4 for the large box.
const RADIUS: usize = 5;

/// The smallest variance by which a squared residual is divided.
const MIN_VARIANCE: f32 = 1e-3;

/// Counts of a block of frames, and the template to which they are compared.
#[derive(Clone, Copy, Debug)]
pub struct Comparison<'a, C = i32> {
    /// N, the number of ones of each pixel, `(H, W)`.
    pub ones: ArrayView2<'a, C>,
    /// D, the number of valid bits of each pixel, `(H, W)`.
    pub trials: ArrayView2<'a, C>,
    /// p, the probability of a one at each pixel of the template, `(H, W)`.
    pub probability: ArrayView2<'a, f32>,
    /// D_R, the number of trials of each pixel of the template, `(H, W)`.
    pub trials_of_template: ArrayView2<'a, i32>,
}

/// Write χ² of each pixel into `out`. It is about 1 if the counts agree with the template.
///
/// The residual counts N/β − D p and their variances D p(1 − p)(1 + 0.35 D/D_R) are added in squares of
/// 3 pixels. The ratio of the squared residual to the variance is averaged over those of 9 pixels
/// that have trials, and over one more pixel whose ratio is 1. β is the brightness of the block, the
/// ratio of Σ N to Σ D p.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the image is
/// empty, a probability is not above 0 and below 1, or counts are not possible.
pub fn chi_squared<C: Count>(
    comparison: &Comparison<'_, C>,
    mut out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    let size = comparison.probability.dim();
    check_template(comparison.probability, comparison.trials_of_template)?;
    check_counts(comparison.ones, comparison.trials, size)?;
    if out.dim() != size {
        return Err(Error::shape("output", size, out.dim()));
    }
    let row = |row| values(comparison.probability.row(row));
    let per_one = 1.0 / brightness(comparison.ones, comparison.trials, row);
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
    fn test_band[C: Count](
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
    let (near, extended) = (rows + 2 * RADIUS, width + 2 * RADIUS);
    let mut counted = vec![0.0; near * extended];
    let mut sums = [(); 2].map(|()| vec![0.0; near * (extended - 2)]);
    let mut terms = [(); 2].map(|()| vec![0.0; extended]);
    for index in 0..near {
        let row = reflect(
            (first + index) as isize - RADIUS as isize,
            comparison.ones.nrows(),
        );
        let counted = &mut counted[index * extended..][..extended];
        compare_row(comparison, per_one, row, &mut terms, counted);
        for (sums, terms) in sums.iter_mut().zip(&terms) {
            add_neighbors(
                terms,
                1,
                &mut sums[index * (extended - 2)..][..extended - 2],
            );
        }
    }
    for plane in &mut sums {
        add_rows(plane, extended - 2, 1, near - 2);
    }
    let [residuals, variances] = &sums;
    let mut averages = [(); 2].map(|()| vec![0.0; (near - 2) * width]);
    let mut ratios = vec![0.0; extended - 2];
    let mut triples = vec![0.0; extended - 4];
    for index in 0..near - 2 {
        let residuals = &residuals[index * (extended - 2)..][..extended - 2];
        let variances = &variances[index * (extended - 2)..][..extended - 2];
        let counted = &counted[(index + 1) * extended + 1..][..extended - 2];
        for i in 0..extended - 2 {
            let large = variances[i] > MIN_VARIANCE;
            let variance = if large { variances[i] } else { MIN_VARIANCE };
            ratios[i] = residuals[i] * residuals[i] / variance * counted[i];
        }
        for (source, averages) in [&ratios[..], counted].into_iter().zip(&mut averages) {
            add_neighbors(source, 1, &mut triples);
            add_neighbors(&triples, 3, &mut averages[index * width..][..width]);
        }
    }
    for plane in &mut averages {
        add_rows(plane, width, 1, near - 4);
        add_rows(plane, width, 3, rows);
    }
    let [ratios, numbers] = &averages;
    for (index, mut out) in out.rows_mut().into_iter().enumerate() {
        let row = index * width..(index + 1) * width;
        let pairs = ratios[row.clone()].iter().zip(&numbers[row]);
        for (out, (ratio, number)) in out.iter_mut().zip(pairs) {
            *out = (ratio + 1.0) / (number + 1.0);
        }
    }
}

/// Compute the residuals, their variances, and whether there are trials, of a row of pixels.
#[inline(always)]
fn compare_row<C: Count>(
    comparison: &Comparison<'_, C>,
    per_one: f32,
    row: usize,
    [residuals, variances]: &mut [Vec<f32>; 2],
    counted: &mut [f32],
) {
    let width = comparison.ones.ncols();
    let inner = RADIUS..RADIUS + width;
    let (ones, trials) = (comparison.ones.row(row), comparison.trials.row(row));
    let (ones, trials) = (values(ones), values(trials));
    let p = values(comparison.probability.row(row));
    let of_template = values(comparison.trials_of_template.row(row));
    let residual = residuals[inner.clone()].iter_mut().zip(ones.iter());
    for ((residual, &ones), (&trials, &p)) in residual.zip(trials.iter().zip(p.iter())) {
        *residual = ones.to_f32() * per_one - trials.to_f32() * p;
    }
    let variance = variances[inner.clone()].iter_mut().zip(trials.iter());
    for ((variance, &trials), (&p, &of_template)) in variance.zip(p.iter().zip(of_template.iter()))
    {
        let trials = trials.to_f32();
        let share = SHARE_OF_TEMPLATE * trials / of_template.max(1) as f32;
        *variance = trials * p * (1.0 - p) * (1.0 + share);
    }
    for (counted, &trials) in counted[inner].iter_mut().zip(trials.iter()) {
        *counted = if trials.to_f32() > 0.0 { 1.0 } else { 0.0 };
    }
    for row in [residuals, variances, counted] {
        reflect_margins(row, RADIUS, width);
    }
}
