//! How much the counts of two parts of the frames disagree.

use ndarray::{ArrayViewMut2, ArrayViewMut3, Axis};
use rayon::prelude::*;

use super::boxes::{
    LastRows, add_neighbors, add_three, add_variances, add_weighted, squared_ratio,
    sums_at_borders, weights_of_variances,
};
use super::brightness::LIMITS;
use super::count::{Count, Counts};
use super::sums::{check_counts, check_shapes};
use crate::bits::contiguous;
use crate::border::{mirror_index, reflect_margins};
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// The side of the squares whose sums are computed, in pixels.
pub const SQUARE: usize = 4;

/// The number of rows of squares that one task computes.
const SQUARES_PER_TASK: usize = 8;

/// The number of sums of a row that are computed together.
const LANES: usize = 16;

/// Write into `out` `(2, ⌈H/SQUARE⌉, ⌈W/SQUARE⌉)` how much two parts disagree, and the numbers of
/// pixels that have trials of both: sums over squares of pixels.
///
/// A pixel disagrees by (Σ N₁D₂ − β N₂D₁)² / v, about 1 if both agree. β is the ratio of the brightness
/// of the first part to that of the second. p = Σ(N₁ + N₂) / Σ(D₁ + D₂/β) is the probability of a one
/// in the first part, so p/β is that in the second. v = p Σ D₁D₂[D₂(1 − p) + D₁(β − p)] is the
/// variance of the difference. These are sums over squares of 3 × 3 pixels. A pixel that a square contains
/// m times, because the image is reflected, adds m² times its variance. Pixels without trials of both
/// disagree by 0.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the image is
/// empty, or counts are not possible.
pub fn disagreement<'a, C: Count>(
    first: &Counts<'a, C>,
    second: &Counts<'a, C>,
    mut out: ArrayViewMut3<'_, f32>,
) -> Result<()> {
    let size = first.ones.dim();
    if first.ones.is_empty() {
        let received = format!("{size:?}");
        return Err(Error::range("size", "at least one pixel", received));
    }
    let shape = (2, size.0.div_ceil(SQUARE), size.1.div_ceil(SQUARE));
    if out.dim() != shape {
        return Err(Error::shape("output", shape, out.dim()));
    }
    let brightness = relative_brightness(first, second)? as f32;
    let (disagreements, numbers) = out.view_mut().split_at(Axis(0), 1);
    let outs = [disagreements, numbers].map(|out| out.remove_axis(Axis(0)));
    let [mut disagreements, mut numbers] = outs;
    let bands = disagreements.axis_chunks_iter_mut(Axis(0), SQUARES_PER_TASK);
    let numbers = numbers.axis_chunks_iter_mut(Axis(0), SQUARES_PER_TASK);
    let bands: Vec<_> = bands.zip(numbers).enumerate().collect();
    bands.into_par_iter().for_each(|(band, out)| {
        if !interrupt::is_requested() {
            let first_row = band * SQUARES_PER_TASK * SQUARE;
            compare_band([first, second], brightness, first_row, out);
        }
    });
    Ok(())
}

/// Return the ratio of the brightness of the first part to that of the second, where both have
/// trials, from 0.1 to 10.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if counts are not
/// possible.
pub fn relative_brightness<'a, C: Count>(
    first: &Counts<'a, C>,
    second: &Counts<'a, C>,
) -> Result<f64> {
    let size = first.ones.dim();
    for part in [first, second] {
        check_shapes(part.ones, part.trials, size)?;
    }
    let sums: Vec<_> = (0..size.0)
        .into_par_iter()
        .map(|row| {
            let rows = [first.ones, first.trials, second.ones, second.trials];
            let rows = rows.map(|counts| contiguous(counts.index_axis_move(Axis(0), row)));
            let (mut sums, mut is_wrong) = ([0.0; 2], false);
            add_comparable(
                rows.each_ref().map(|row| &row[..]),
                &mut sums,
                &mut is_wrong,
            );
            (sums, is_wrong)
        })
        .collect();
    if sums.iter().any(|&(_, is_wrong)| is_wrong) {
        check_counts(first.ones, first.trials, size)?;
        check_counts(second.ones, second.trials, size)?;
    }
    // The sums over the rows have a fixed order.
    let total = |index: usize| sums.iter().map(|(sums, _)| sums[index]).sum::<f64>();
    Ok((total(0) / total(1).max(1.0)).clamp(LIMITS.0, LIMITS.1))
}

/// The sums of a row of pixels: of the ones; of the trials D₁ + D₂/β; of the differences; and of the
/// factors D₁D₂(D₂ + βD₁) of p, and D₁D₂(D₁ + D₂) of p², in the variance.
const TERMS: usize = 5;

/// The terms before those of the variance.
const LINEAR: usize = 3;

/// Two images of squares: the disagreements, and the numbers of pixels.
type Squares<'a> = (ArrayViewMut2<'a, f32>, ArrayViewMut2<'a, f32>);

levels! {
    /// Add the ones of a row, where both parts have trials: those of the first part in as many
    /// trials as the second one has, and those of the second part. Also find counts that are not
    /// possible.
    fn add_comparable[C: Count](
        row: [&[C]; 4], sums: &mut [f64; 2], is_wrong: &mut bool,
    ) = add_comparable_inlined;
    /// Compare some rows, of which `first_row` is the first.
    fn compare_band[C: Count](
        parts: [&Counts<'_, C>; 2], brightness: f32, first_row: usize, out: Squares<'_>,
    ) = compare_band_inlined;
}

#[inline(always)]
fn add_comparable_inlined<C: Count>(row: [&[C]; 4], sums: &mut [f64; 2], is_wrong: &mut bool) {
    for [ones, trials] in [[row[0], row[1]], [row[2], row[3]]] {
        // Without an early end, the compiler vectorizes the search.
        let pairs = ones.iter().zip(trials);
        *is_wrong |= pairs.fold(false, |any, (&ones, &trials)| {
            any | !C::are_possible(ones, trials)
        });
    }
    let mut lanes = [[0.0; LANES]; 2];
    let width = row[0].len();
    let parts = row.map(|counts| counts.as_chunks::<LANES>());
    let terms = |[ones, trials, others, other_trials]: [C; 4]| {
        let (trials, other_trials) = (trials.to_f64(), other_trials.to_f64());
        let known = trials > 0.0 && other_trials > 0.0;
        let divisor = if known { trials } else { 1.0 };
        [
            if known {
                other_trials * ones.to_f64() / divisor
            } else {
                0.0
            },
            if known { others.to_f64() } else { 0.0 },
        ]
    };
    for chunk in 0..width / LANES {
        let part = parts.each_ref().map(|(chunks, _)| &chunks[chunk]);
        for lane in 0..LANES {
            let [first, second] = terms(part.map(|counts| counts[lane]));
            lanes[0][lane] += first;
            lanes[1][lane] += second;
        }
    }
    for index in 0..width % LANES {
        let [first, second] = terms(parts.each_ref().map(|(_, rest)| rest[index]));
        lanes[0][0] += first;
        lanes[1][0] += second;
    }
    for (sum, lanes) in sums.iter_mut().zip(&lanes) {
        *sum += lanes.iter().sum::<f64>();
    }
}

#[inline(always)]
fn compare_band_inlined<C: Count>(
    parts: [&Counts<'_, C>; 2],
    brightness: f32,
    first_row: usize,
    (mut disagreements, mut numbers): Squares<'_>,
) {
    let (height, width) = parts[0].ones.dim();
    let rows = (disagreements.nrows() * SQUARE).min(height - first_row);
    let mut terms = [(); TERMS].map(|()| vec![0.0; width + 2]);
    let mut sums = [(); TERMS].map(|()| LastRows::<3>::new(width));
    let mut totals = [(); TERMS].map(|()| vec![0.0; width]);
    let mut known = LastRows::<3>::new(width);
    let mut ratios = vec![0.0; width];
    let at_borders = sums_at_borders(1, width);
    // Only the last rows are kept, which stay in the fastest cache.
    for index in 0..rows + 2 {
        let place = (first_row + index) as isize - 1;
        let row = mirror_index(place, height);
        compare_row(parts, brightness, row, &mut terms, known.row_mut(index));
        for (sums, terms) in sums[..LINEAR].iter_mut().zip(&terms) {
            add_neighbors(terms, 1, sums.row_mut(index));
        }
        for (sums, terms) in sums[LINEAR..].iter_mut().zip(&terms[LINEAR..]) {
            add_variances(terms, &at_borders, sums.row_mut(index));
        }
        let Some(row) = index.checked_sub(2) else {
            continue;
        };
        let weights = weights_of_variances(place - 2, height);
        for (term, (total, sums)) in totals.iter_mut().zip(&sums).enumerate() {
            let rows = [0, 1, 2].map(|k| sums.row(row + k));
            if term < LINEAR {
                add_three(rows, total);
            } else {
                add_weighted(rows, weights, total);
            }
        }
        let known = known.row(row + 1);
        divide(
            totals.each_ref().map(|total| &total[..]),
            known,
            brightness,
            &mut ratios,
        );
        for (plane, values) in [(&mut disagreements, &ratios[..]), (&mut numbers, known)] {
            let mut squares = plane.row_mut(row / SQUARE);
            if row % SQUARE == 0 {
                squares.fill(0.0);
            }
            for (square, values) in squares.iter_mut().zip(values.chunks(SQUARE)) {
                *square += values.iter().sum::<f32>();
            }
        }
    }
}

/// Divide the squared differences of a row by their variances.
#[inline(always)]
fn divide(sums: [&[f32]; TERMS], known: &[f32], brightness: f32, ratios: &mut [f32]) {
    let width = ratios.len();
    let [ones, trials, differences, linear, quadratic] = sums.map(|plane| &plane[..width]);
    let known = &known[..width];
    let max_p = brightness.min(1.0);
    for i in 0..width {
        // Pixels without trials, such as those of dead jots, must not make p smaller.
        let number = if trials[i] > 1.0 { trials[i] } else { 1.0 };
        // Sums of real numbers may be smaller than a single one, or negative. Sums of bits are 0
        // then, and agree.
        let ones = if ones[i] > 1.0 { ones[i] } else { 1.0 };
        let share = ones / number;
        let p = if share < max_p { share } else { max_p };
        let variance = p * (linear[i] - p * quadratic[i]);
        ratios[i] = squared_ratio(differences[i], variance) * known[i];
    }
}

/// Compute the terms of a row of pixels, with one more at each end, and whether both parts have
/// trials.
#[inline(always)]
fn compare_row<C: Count>(
    [first, second]: [&Counts<'_, C>; 2],
    brightness: f32,
    row: usize,
    terms: &mut [Vec<f32>; TERMS],
    known: &mut [f32],
) {
    let width = known.len();
    let (ones, trials) = (
        contiguous(first.ones.row(row)),
        contiguous(first.trials.row(row)),
    );
    let (others, other_trials) = (
        contiguous(second.ones.row(row)),
        contiguous(second.trials.row(row)),
    );
    let [all, numbers, differences, linear, quadratic] =
        terms.each_mut().map(|term| &mut term[1..][..width]);
    let inverse = 1.0 / brightness;
    for i in 0..width {
        let (ones, others) = (ones[i].to_f32(), others[i].to_f32());
        let (trials, other_trials) = (trials[i].to_f32(), other_trials[i].to_f32());
        let weight = trials * other_trials;
        all[i] = ones + others;
        numbers[i] = trials + inverse * other_trials;
        differences[i] = ones * other_trials - brightness * others * trials;
        linear[i] = weight * (other_trials + brightness * trials);
        quadratic[i] = weight * (trials + other_trials);
        known[i] = if weight > 0.0 { 1.0 } else { 0.0 };
    }
    for term in terms {
        reflect_margins(term, 1, width);
    }
}
