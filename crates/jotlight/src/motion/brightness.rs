//! The brightness of blocks of frames, relative to that of a template.

use std::borrow::Cow;

use ndarray::ArrayView2;
use rayon::prelude::*;

use super::count::{Count, Counts};
use super::sums::{check_counts, check_shapes};
use super::template::{are_possible, check_template, check_template_shapes};
use crate::bits::contiguous;
use crate::cpu::levels;
use crate::error::{Error, Result};

/// The number of sums that are computed together.
const LANES: usize = 16;

/// The range of the brightness.
pub(super) const LIMITS: (f64, f64) = (0.1, 10.0);

/// The number of ones, and of zeros, that are added to the counts of each pixel with trials.
///
/// Where the light is dim or saturated, hardly any bits differ from the others, and these few would
/// disagree: a single zero among bright pixels is much more than the expected number of zeros.
pub(super) const RARE: f32 = 0.02;

/// The sums of a row of pixels.
#[derive(Clone, Copy, Default)]
struct RowSums {
    /// Σ N.
    counted: f64,
    /// Σ D p.
    expected: f64,
    /// Whether counts are not possible.
    is_wrong: bool,
}

/// Return the ratio of the ones N to the number D p that a template `(H, W)` predicts, in sums over
/// all pixels, from 0.1 to 10.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if counts are not
/// possible.
pub fn brightness_of<C: Count>(
    ones: ArrayView2<'_, C>,
    trials: ArrayView2<'_, C>,
    probability: ArrayView2<'_, f32>,
) -> Result<f64> {
    check_shapes(ones, trials, probability.dim())?;
    let parts = [Counts { ones, trials }];
    checked_ratio(&parts, |row| contiguous(probability.row(row)))
}

/// Return what [`brightness_of`] returns for counts whose shapes match. `row(i)` are the
/// probabilities of the row i of pixels.
pub(super) fn checked_ratio<'a, C: Count>(
    parts: &[Counts<'_, C>],
    row: impl Fn(usize) -> Cow<'a, [f32]> + Sync,
) -> Result<f64> {
    if let Some(ratio) = ratio(parts, row, |_| true) {
        return Ok(ratio);
    }
    for part in parts {
        check_counts(part.ones, part.trials, part.ones.dim())?;
    }
    Err(Error::range("counts", "possible ones", "others"))
}

/// Return the brightness of each of some blocks, the ratio of Σ N to Σ D p, after a check of all values.
///
/// The check reads each row while the ratio does, so all are read only once.
pub(super) fn brightness_of_blocks<C: Count>(
    blocks: &[&[Counts<'_, C>]],
    probability: ArrayView2<'_, f32>,
    trials_of_template: ArrayView2<'_, i32>,
) -> Result<Vec<f64>> {
    check_template_shapes(probability, trials_of_template)?;
    let parts = || blocks.iter().flat_map(|parts| parts.iter());
    for part in parts() {
        check_shapes(part.ones, part.trials, probability.dim())?;
    }
    let row = |row| contiguous(probability.row(row));
    let is_possible = |row| {
        let trials = contiguous(trials_of_template.row(row));
        are_possible(&contiguous(probability.row(row)), &trials)
    };
    if let Some(ratios) = ratios(blocks, row, is_possible, f64::from(RARE)) {
        return Ok(ratios);
    }
    check_template(probability, trials_of_template)?;
    for part in parts() {
        check_counts(part.ones, part.trials, probability.dim())?;
    }
    Err(Error::range("counts", "possible ones", "others"))
}

/// Return what [`ratios`] returns for one block.
fn ratio<'a, C: Count>(
    parts: &[Counts<'_, C>],
    row: impl Fn(usize) -> Cow<'a, [f32]> + Sync,
    is_possible: impl Fn(usize) -> bool + Sync,
) -> Option<f64> {
    ratios(&[parts], row, is_possible, 0.0)?.first().copied()
}

/// Return, for each of several blocks, the ratio of the ones of all of its parts together to the number
/// D p that a template predicts, after `added` ones are added to both for each pixel. Return None if
/// counts are not possible, or `is_possible` is false for a row.
///
/// Lamps flicker, and clouds pass. The ratio is 1 if the template predicts no ones. The sums of parts
/// that several blocks have in common are computed once.
fn ratios<'a, C: Count>(
    blocks: &[&[Counts<'_, C>]],
    row: impl Fn(usize) -> Cow<'a, [f32]> + Sync,
    is_possible: impl Fn(usize) -> bool + Sync,
    added: f64,
) -> Option<Vec<f64>> {
    let (distinct, indices) = distinct_parts(blocks);
    let (rows, width) = distinct.first().map_or((0, 0), |part| part.ones.dim());
    let sums: Vec<Vec<RowSums>> = (0..rows)
        .into_par_iter()
        .map(|index| {
            let p = row(index);
            let is_wrong = !is_possible(index);
            let sums = distinct.iter().map(|part| {
                let mut sums = RowSums {
                    is_wrong,
                    ..RowSums::default()
                };
                let (ones, trials) = (
                    contiguous(part.ones.row(index)),
                    contiguous(part.trials.row(index)),
                );
                add_row(&ones, &trials, &p, &mut sums);
                sums
            });
            sums.collect()
        })
        .collect();
    if sums.iter().flatten().any(|sums| sums.is_wrong) {
        return None;
    }
    let added = added * (rows * width) as f64;
    let ratio = |parts: &Vec<usize>| {
        // The sums over the rows have a fixed order.
        let total = |value: fn(&RowSums) -> f64| -> f64 {
            let of_row =
                |sums: &Vec<RowSums>| parts.iter().map(|&part| value(&sums[part])).sum::<f64>();
            added + sums.iter().map(of_row).sum::<f64>()
        };
        let (counted, expected) = (total(|sums| sums.counted), total(|sums| sums.expected));
        if expected > 0.0 {
            (counted / expected).clamp(LIMITS.0, LIMITS.1)
        } else {
            1.0
        }
    };
    Some(indices.iter().map(ratio).collect())
}

/// Return the parts of all blocks without repetitions, and their indices in each block.
fn distinct_parts<'a, C: Count>(
    blocks: &[&[Counts<'a, C>]],
) -> (Vec<Counts<'a, C>>, Vec<Vec<usize>>) {
    let same = |one: &Counts<'_, C>, other: &Counts<'_, C>| {
        one.ones.as_ptr() == other.ones.as_ptr()
            && one.trials.as_ptr() == other.trials.as_ptr()
            && one.ones.strides() == other.ones.strides()
            && one.trials.strides() == other.trials.strides()
    };
    let mut distinct: Vec<Counts<'a, C>> = Vec::new();
    let mut index = |part: &Counts<'a, C>| {
        let known = distinct.iter().position(|other| same(part, other));
        known.unwrap_or_else(|| {
            distinct.push(*part);
            distinct.len() - 1
        })
    };
    let indices = blocks
        .iter()
        .map(|parts| parts.iter().map(&mut index).collect());
    let indices = indices.collect();
    (distinct, indices)
}

levels! {
    /// Compute the sums of a row.
    fn add_row[C: Count](ones: &[C], trials: &[C], p: &[f32], sums: &mut RowSums) = add_row_inlined;
}

#[inline(always)]
fn add_row_inlined<C: Count>(ones: &[C], trials: &[C], p: &[f32], sums: &mut RowSums) {
    sums.counted = C::sum(ones);
    // Without an early end, the compiler vectorizes the search.
    sums.is_wrong |= ones
        .iter()
        .zip(trials)
        .fold(false, |any, (&ones, &trials)| {
            any | !C::are_possible(ones, trials)
        });
    sums.expected = predict(trials, p);
}

/// Replace `counts` with the numbers of ones and of trials of a row of all parts together.
#[inline(always)]
pub(super) fn add_parts<C: Count>(
    parts: &[Counts<'_, C>],
    row: usize,
    [ones, trials]: &mut [Vec<f32>; 2],
) {
    for (index, part) in parts.iter().enumerate() {
        let planes = [(part.ones, &mut *ones), (part.trials, &mut *trials)];
        for (counts, out) in planes {
            let counts = contiguous(counts.index_axis_move(ndarray::Axis(0), row));
            let pairs = out.iter_mut().zip(counts.iter());
            if index == 0 {
                pairs.for_each(|(out, count)| *out = count.to_f32());
            } else {
                pairs.for_each(|(out, count)| *out += count.to_f32());
            }
        }
    }
}

/// Return Σ D p of a row. Several sums at a time let the compiler vectorize it.
#[inline(always)]
fn predict<C: Count>(trials: &[C], p: &[f32]) -> f64 {
    let mut sums = [0.0; LANES];
    let (trials, trials_rest) = trials.as_chunks::<LANES>();
    let (p, p_rest) = p.as_chunks::<LANES>();
    for (trials, p) in trials.iter().zip(p) {
        for lane in 0..LANES {
            sums[lane] += trials[lane].to_f32() * p[lane];
        }
    }
    let rest = trials_rest.iter().zip(p_rest);
    let rest: f32 = rest.map(|(&trials, &p)| trials.to_f32() * p).sum();
    sums.iter().copied().map(f64::from).sum::<f64>() + f64::from(rest)
}
