//! The brightness of a block of frames, relative to that of a template.

use rayon::prelude::*;

use ndarray::ArrayView2;

use super::count::Count;
use super::filter::values;
use super::sums::check_counts;
use crate::error::Result;

/// The number of sums that are computed together.
const LANES: usize = 16;

/// The range of the brightness.
pub(super) const LIMITS: (f64, f64) = (0.1, 10.0);

/// Return the ratio of the ones N to the number D p that a template `(H, W)` predicts, in sums over
/// all pixels, from 0.1 to 10.
///
/// # Errors
/// [`Shape`](crate::error::Error::Shape) if the shapes of the arrays do not match.
/// [`Range`](crate::error::Error::Range) if counts are not possible.
pub fn brightness_of<C: Count>(
    ones: ArrayView2<'_, C>,
    trials: ArrayView2<'_, C>,
    probability: ArrayView2<'_, f32>,
) -> Result<f64> {
    check_counts(ones, trials, probability.dim())?;
    let row = |row| values(probability.row(row));
    Ok(ratio(ones, trials, row))
}

/// Return the ratio of the ones N to the number D p that a template predicts, in sums over all
/// pixels.
///
/// Lamps flicker, and clouds pass. The ratio is 1 if the template predicts no ones. `row(i)` are
/// the probabilities of the row i of pixels.
pub(super) fn brightness<'a, C: Count>(
    ones: ArrayView2<'_, C>,
    trials: ArrayView2<'_, C>,
    row: impl Fn(usize) -> std::borrow::Cow<'a, [f32]> + Sync,
) -> f32 {
    ratio(ones, trials, row) as f32
}

/// Return what [`brightness`] returns, in double precision.
fn ratio<'a, C: Count>(
    ones: ArrayView2<'_, C>,
    trials: ArrayView2<'_, C>,
    row: impl Fn(usize) -> std::borrow::Cow<'a, [f32]> + Sync,
) -> f64 {
    let sums: Vec<[f64; 2]> = (0..ones.nrows())
        .into_par_iter()
        .map(|index| {
            let (ones, trials, p) = (
                values(ones.row(index)),
                values(trials.row(index)),
                row(index),
            );
            [C::sum(&ones), predict(&trials, &p)]
        })
        .collect();
    // The sums over the rows have a fixed order.
    let total = |index: usize| sums.iter().map(|sums| sums[index]).sum::<f64>();
    let (counted, expected) = (total(0), total(1));
    if expected > 0.0 {
        (counted / expected).clamp(LIMITS.0, LIMITS.1)
    } else {
        1.0
    }
}

/// Return Σ D p of a row. Several sums at a time let the compiler vectorize it.
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
