//! The most probable curve of an affine motion in time, from noisy estimates of single blocks.

use ndarray::{Array2, ArrayView2, ArrayView3};

use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;
use crate::values::check_not_negative;

/// The number of modes of an affine motion: two translations, zoom, rotation, and two shears.
pub const MODES: usize = 6;

/// The number of terms of [`TERMS`], each with its own weight.
pub const WEIGHTS: usize = 4;

/// The first of two modes, and the order of the differences that are small: the third differences
/// of translations, the first and third ones of zoom and rotation, and the first ones of shears.
const TERMS: [(usize, usize); WEIGHTS] = [(0, 3), (2, 1), (2, 3), (4, 1)];

/// The largest order.
const ORDER: usize = 3;

/// The number of diagonals below the main one.
const BAND: usize = MODES * ORDER;

/// The logarithms of the weights with which the search begins, relative to the mean information.
const FIRST: Logarithms = [0.0; WEIGHTS];

/// The smallest and the largest logarithm of a weight, relative to the same.
const LIMITS: (f64, f64) = (-16.0, 16.0);

/// The steps of the search for the logarithms of the weights.
const STEPS: [f64; 4] = [4.0, 2.0, 1.0, 0.5];

/// The smallest improvement in nats for which the search continues.
const MIN_GAIN: f64 = 1e-3;

/// Logarithms of the weights of the squared differences of each term.
pub type Logarithms = [f64; WEIGHTS];

/// A row of several symmetric matrices: the entries of the columns up to [`BAND`] before the diagonal, and
/// that on it. Those of all matrices are side by side, so that the compiler vectorizes the loops.
type Row<const N: usize> = [[f64; N]; BAND + 1];

/// Noisy estimates of the modes of n blocks, in units in which the mean information is about 1.
#[derive(Clone, Debug)]
pub struct Curve {
    estimates: Vec<f64>,
    /// The information M.
    information: Vec<Row<1>>,
    /// M y for the estimates y.
    right: Vec<f64>,
    /// The squared third differences of the curves whose squared first differences are 1.
    ratios: Vec<f64>,
}

impl Curve {
    /// Return the curve with the estimates `(n, 6)`, the information about them `(n, 6, 6)`, which
    /// is positive, and the squared third differences of the n − 1 curves whose squared first
    /// differences are 1.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes do not match. [`Error::Range`] if there are three blocks or
    /// fewer, a value is not finite, or a squared difference is negative.
    pub fn new(
        estimates: ArrayView2<'_, f64>,
        information: ArrayView3<'_, f64>,
        ratios: &[f64],
    ) -> Result<Self> {
        let number = estimates.nrows();
        if number <= ORDER {
            return Err(Error::range("blocks", "more than three", number));
        }
        if estimates.dim() != (number, MODES) {
            return Err(Error::shape("estimates", (number, MODES), estimates.dim()));
        }
        if information.dim() != (number, MODES, MODES) {
            let expected = (number, MODES, MODES);
            return Err(Error::shape("information", expected, information.dim()));
        }
        if ratios.len() != number - 1 {
            return Err(Error::shape("ratios", number - 1, ratios.len()));
        }
        let mut values = estimates.iter().chain(&information);
        if let Some(value) = values.find(|value| !value.is_finite()) {
            return Err(Error::range(
                "estimates of a curve",
                "finite numbers",
                value,
            ));
        }
        check_not_negative("squared differences of curves", ratios)?;
        let estimates: Vec<f64> = estimates.iter().copied().collect();
        let mut rows = vec![[[0.0]; BAND + 1]; estimates.len()];
        let mut right = vec![0.0; estimates.len()];
        for (index, row) in rows.iter_mut().enumerate() {
            let (block, mode) = (index / MODES, index % MODES);
            for other in 0..MODES {
                let entry = information[[block, mode, other]];
                right[index] += entry * estimates[block * MODES + other];
                if other <= mode {
                    row[BAND + other - mode] = [entry];
                }
            }
        }
        Ok(Self {
            estimates,
            information: rows,
            right,
            ratios: ratios.to_vec(),
        })
    }

    /// Return the most probable curve `(n, 6)`.
    ///
    /// The errors of the estimates y are Gaussian with the information M, and the differences of
    /// the curve x are Gaussian with variances e⁻ʷ. So x minimizes (x − y)ᵀM(x − y) + Σ eʷ|Δx|². The
    /// weights w are those under which y is most probable (restricted maximum likelihood).
    ///
    /// # Errors
    /// [`Error::Range`] if the information is not positive, or the estimates are so large that their
    /// cost is not finite. [`Error::Interrupted`].
    pub fn smooth(&self) -> Result<Array2<f64>> {
        let (mut best, mut cost) = (FIRST, self.cost(&FIRST)?.0);
        for step in STEPS {
            loop {
                if interrupt::is_requested() {
                    return Err(Error::Interrupted);
                }
                let others: [_; 2 * WEIGHTS] = std::array::from_fn(|neighbor| {
                    let (index, sign) = (neighbor / 2, [1.0, -1.0][neighbor % 2]);
                    let mut weights = best;
                    weights[index] = (best[index] + sign * step).clamp(LIMITS.0, LIMITS.1);
                    weights
                });
                let (costs, _) = self.costs(&others)?;
                let (mut nearby, mut lowest) = (best, f64::INFINITY);
                for (weights, other) in others.into_iter().zip(costs) {
                    if other < lowest {
                        (nearby, lowest) = (weights, other);
                    }
                }
                if lowest < cost - MIN_GAIN {
                    (best, cost) = (nearby, lowest);
                } else {
                    break;
                }
            }
        }
        Ok(self.cost(&best)?.1)
    }

    /// Return −2 log p(y | w) without a constant, and the most probable curve under weights.
    ///
    /// # Errors
    /// [`Error::Range`] if the information is not positive, or the cost is not finite: a weight is NaN
    /// or too large, or the estimates are too large.
    pub fn cost(&self, weights: &Logarithms) -> Result<(f64, Array2<f64>)> {
        let ([cost], solution) = self.costs(&[*weights])?;
        let number = self.estimates.len() / MODES;
        let curve = Array2::from_shape_fn((number, MODES), |(i, j)| solution[i * MODES + j][0]);
        Ok((cost, curve))
    }

    /// Return the results of [`Self::cost`] under each of several weights, side by side.
    fn costs<const N: usize>(
        &self,
        weights: &[Logarithms; N],
    ) -> Result<([f64; N], Vec<[f64; N]>)> {
        let number = self.estimates.len() / MODES;
        let spread = |row: &Row<1>| row.map(|[entry]| [entry; N]);
        let mut matrices: Vec<Row<N>> = self.information.iter().map(spread).collect();
        for (term, &(first, order)) in TERMS.iter().enumerate() {
            let factors = weights.map(|weights| weights[term].exp());
            for (block, squares) in squares_of_differences(number, order).iter().enumerate() {
                for mode in [first, first + 1] {
                    let row = &mut matrices[block * MODES + mode];
                    for (distance, square) in squares.iter().enumerate().take(order + 1) {
                        let entries = row[BAND - distance * MODES].iter_mut().zip(factors);
                        entries.for_each(|(entry, factor)| *entry += factor * square);
                    }
                }
            }
        }
        let (mut costs, mut wrong) = ([0.0; N], None);
        factorize(&mut matrices, &mut costs, &mut wrong);
        if let Some(pivot) = wrong {
            return Err(Error::range("information", "positive matrices", pivot));
        }
        let mut solution: Vec<_> = self.right.iter().map(|&value| [value; N]).collect();
        solve(&matrices, &mut solution);
        for (index, cost) in costs.iter_mut().enumerate() {
            let pairs = self.right.iter().zip(self.estimates.iter().zip(&solution));
            let residual: f64 = pairs
                .map(|(right, (estimate, value))| right * (estimate - value[index]))
                .sum();
            *cost = residual + *cost - self.log_prior(&weights[index]);
        }
        if let Some(cost) = costs.iter().find(|cost| !cost.is_finite()) {
            let expected = "weights and estimates whose cost is finite";
            return Err(Error::range("estimates of a curve", expected, cost));
        }
        Ok((costs, solution))
    }

    /// Return the logarithm of the determinant of Σ eʷ ΔᵀΔ, without those of null spaces.
    fn log_prior(&self, weights: &Logarithms) -> f64 {
        let number = (self.estimates.len() / MODES) as f64;
        let [translations, first, third, shears] = *weights;
        let similarity = |ratio: &f64| (first.exp() + third.exp() * ratio).ln();
        let similarities: f64 = self.ratios.iter().map(similarity).sum();
        let total = (number - 3.0) * translations + (number - 1.0) * shears + similarities;
        // Two modes have each term.
        2.0 * total
    }
}

/// Return ΔᵀΔ for the differences of an order of n values: the entries of each row at a distance
/// of 0, 1, … before the diagonal.
fn squares_of_differences(number: usize, order: usize) -> Vec<[f64; ORDER + 1]> {
    let taps: &[f64] = match order {
        1 => &[-1.0, 1.0],
        _ => &[-1.0, 3.0, -3.0, 1.0],
    };
    let mut squares = vec![[0.0; ORDER + 1]; number];
    for first in 0..number - order {
        for (i, a) in taps.iter().enumerate() {
            for (j, b) in taps[..=i].iter().enumerate() {
                squares[first + i][i - j] += a * b;
            }
        }
    }
    squares
}

levels! {
    /// Replace symmetric matrices with their roots of Cholesky, and write the logarithms of their
    /// determinants, or a pivot that is not positive.
    fn factorize[const N: usize](
        matrices: &mut [Row<N>], logarithms: &mut [f64; N], wrong: &mut Option<f64>,
    ) = factorize_inlined;
    /// Replace the right sides of equations with their solutions, from the roots of the matrices.
    fn solve[const N: usize](roots: &[Row<N>], solutions: &mut [[f64; N]]) = solve_inlined;
}

#[inline(always)]
fn factorize_inlined<const N: usize>(
    matrices: &mut [Row<N>],
    logarithms: &mut [f64; N],
    wrong: &mut Option<f64>,
) {
    for i in 0..matrices.len() {
        let (above, below) = matrices.split_at_mut(i);
        let row = &mut below[0];
        for j in i.saturating_sub(BAND)..i {
            let other = &above[j];
            let shift = i - j;
            // Columns k of both rows: row[BAND + k − i] and other[BAND + k − j].
            let known = add_products(&row[..BAND - shift], &other[shift..BAND]);
            for lane in 0..N {
                row[BAND - shift][lane] =
                    (row[BAND - shift][lane] - known[lane]) / other[BAND][lane];
            }
        }
        let known = add_products(&row[..BAND], &row[..BAND]);
        for lane in 0..N {
            let pivot = row[BAND][lane] - known[lane];
            if !(pivot > 0.0 && pivot.is_finite()) {
                *wrong = Some(pivot);
                return;
            }
            logarithms[lane] += pivot.ln();
            row[BAND][lane] = pivot.sqrt();
        }
    }
}

#[inline(always)]
fn solve_inlined<const N: usize>(roots: &[Row<N>], solutions: &mut [[f64; N]]) {
    for (i, row) in roots.iter().enumerate() {
        let near = BAND.min(i);
        let known = add_products(&row[BAND - near..BAND], &solutions[i - near..i]);
        for lane in 0..N {
            solutions[i][lane] = (solutions[i][lane] - known[lane]) / row[BAND][lane];
        }
    }
    for (i, row) in roots.iter().enumerate().rev() {
        let near = BAND.min(i);
        for lane in 0..N {
            solutions[i][lane] /= row[BAND][lane];
        }
        let (others, values) = solutions.split_at_mut(i);
        for (other, entries) in others[i - near..].iter_mut().zip(&row[BAND - near..BAND]) {
            for lane in 0..N {
                other[lane] -= entries[lane] * values[0][lane];
            }
        }
    }
}

/// Return the sums of products of entries, for each matrix.
#[inline(always)]
fn add_products<const N: usize>(first: &[[f64; N]], second: &[[f64; N]]) -> [f64; N] {
    let mut sums = [0.0; N];
    for (a, b) in first.iter().zip(second) {
        for lane in 0..N {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums
}
