//! The brightness of a block of frames, relative to that of a template.

use rayon::prelude::*;

use ndarray::ArrayView2;

use super::filter::values;

/// The range of the brightness.
const LIMITS: (f64, f64) = (0.1, 10.0);

/// Return the ratio of the ones N to the number D p that a template predicts, in sums over all
/// pixels.
///
/// Lamps flicker, and clouds pass. The ratio is 1 if the template predicts no ones. `row(i)` are
/// the probabilities of the row i of pixels.
pub(super) fn brightness<'a>(
    ones: ArrayView2<'_, i32>,
    trials: ArrayView2<'_, i32>,
    row: impl Fn(usize) -> std::borrow::Cow<'a, [f32]> + Sync,
) -> f32 {
    let sums: Vec<[f64; 2]> = (0..ones.nrows())
        .into_par_iter()
        .map(|index| {
            let (ones, trials, p) = (
                values(ones.row(index)),
                values(trials.row(index)),
                row(index),
            );
            let counted: i64 = ones.iter().map(|&count| i64::from(count)).sum();
            let expected = trials.iter().zip(p.iter());
            let expected: f32 = expected.map(|(&trials, &p)| trials as f32 * p).sum();
            [counted as f64, f64::from(expected)]
        })
        .collect();
    // The sums over the rows have a fixed order.
    let total = |index: usize| sums.iter().map(|sums| sums[index]).sum::<f64>();
    let (counted, expected) = (total(0), total(1));
    if expected > 0.0 {
        (counted / expected).clamp(LIMITS.0, LIMITS.1) as f32
    } else {
        1.0
    }
}
