//! The most probable curve of an affine motion in time, from noisy estimates of single blocks.

use ndarray::{Array2, ArrayView2, ArrayView3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::interrupt;

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

/// A row of a symmetric matrix: the entries of the columns up to [`BAND`] before the diagonal, and
/// that on it.
type Row = [f64; BAND + 1];

/// Noisy estimates of the modes of n blocks, in units in which the mean information is about 1.
#[derive(Clone, Debug)]
pub struct Curve {
    estimates: Vec<f64>,
    /// The information M.
    information: Vec<Row>,
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
    /// fewer, or a value is not finite.
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
        let mut values = estimates.iter().chain(&information).chain(ratios);
        if let Some(value) = values.find(|value| !value.is_finite()) {
            return Err(Error::range(
                "estimates of a curve",
                "finite numbers",
                value,
            ));
        }
        let estimates: Vec<f64> = estimates.iter().copied().collect();
        let mut rows = vec![[0.0; BAND + 1]; estimates.len()];
        let mut right = vec![0.0; estimates.len()];
        for (index, row) in rows.iter_mut().enumerate() {
            let (block, mode) = (index / MODES, index % MODES);
            for other in 0..MODES {
                let entry = information[[block, mode, other]];
                right[index] += entry * estimates[block * MODES + other];
                if other <= mode {
                    row[BAND + other - mode] = entry;
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
    /// [`Error::Range`] if the information is not positive. [`Error::Interrupted`].
    pub fn smooth(&self) -> Result<Array2<f64>> {
        let (mut best, mut cost) = (FIRST, self.cost(&FIRST)?.0);
        for step in STEPS {
            loop {
                if interrupt::is_requested() {
                    return Err(Error::Interrupted);
                }
                let others = (0..2 * WEIGHTS).into_par_iter().map(|neighbor| {
                    let (index, sign) = (neighbor / 2, [1.0, -1.0][neighbor % 2]);
                    let mut weights = best;
                    weights[index] = (best[index] + sign * step).clamp(LIMITS.0, LIMITS.1);
                    Ok((weights, self.cost(&weights)?.0))
                });
                let (mut nearby, mut lowest) = (best, f64::INFINITY);
                for (weights, other) in others.collect::<Result<Vec<_>>>()? {
                    if other < lowest {
                        (nearby, lowest) = (weights, other);
                    }
                }
                if lowest > cost - MIN_GAIN {
                    break;
                }
                (best, cost) = (nearby, lowest);
            }
        }
        Ok(self.cost(&best)?.1)
    }

    /// Return −2 log p(y | w) without a constant, and the most probable curve under weights.
    ///
    /// # Errors
    /// [`Error::Range`] if the information is not positive, or a weight is too large.
    pub fn cost(&self, weights: &Logarithms) -> Result<(f64, Array2<f64>)> {
        let number = self.estimates.len() / MODES;
        let mut matrix = self.information.clone();
        for (&(first, order), weight) in TERMS.iter().zip(weights) {
            let factor = weight.exp();
            for (block, squares) in squares_of_differences(number, order).iter().enumerate() {
                for mode in [first, first + 1] {
                    let row = &mut matrix[block * MODES + mode];
                    for (distance, square) in squares.iter().enumerate().take(order + 1) {
                        row[BAND - distance * MODES] += factor * square;
                    }
                }
            }
        }
        let determinant = factorize(&mut matrix)?;
        let solution = solve(&matrix, &self.right);
        let residual: f64 = self
            .right
            .iter()
            .zip(self.estimates.iter().zip(&solution))
            .map(|(right, (estimate, value))| right * (estimate - value))
            .sum();
        let curve = Array2::from_shape_fn((number, MODES), |(i, j)| solution[i * MODES + j]);
        Ok((residual + determinant - self.log_prior(weights), curve))
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

/// Replace a symmetric matrix with its root of Cholesky, and return the logarithm of its
/// determinant.
fn factorize(matrix: &mut [Row]) -> Result<f64> {
    let mut logarithm = 0.0;
    for i in 0..matrix.len() {
        let (above, below) = matrix.split_at_mut(i);
        let row = &mut below[0];
        for j in i.saturating_sub(BAND)..i {
            let other = &above[j];
            let shift = i - j;
            // Columns k of both rows: row[BAND + k − i] and other[BAND + k − j].
            let known: f64 = row[..BAND - shift]
                .iter()
                .zip(&other[shift..BAND])
                .map(|(a, b)| a * b)
                .sum();
            row[BAND - shift] = (row[BAND - shift] - known) / other[BAND];
        }
        let known: f64 = row[..BAND].iter().map(|a| a * a).sum();
        let pivot = row[BAND] - known;
        if !(pivot > 0.0 && pivot.is_finite()) {
            return Err(Error::range("information", "positive matrices", pivot));
        }
        logarithm += pivot.ln();
        row[BAND] = pivot.sqrt();
    }
    Ok(logarithm)
}

/// Return the solution of equations, given the root of their matrix.
fn solve(root: &[Row], right: &[f64]) -> Vec<f64> {
    let mut solution = right.to_vec();
    for (i, row) in root.iter().enumerate() {
        let near = BAND.min(i);
        let known: f64 = row[BAND - near..BAND]
            .iter()
            .zip(&solution[i - near..i])
            .map(|(a, b)| a * b)
            .sum();
        solution[i] = (solution[i] - known) / row[BAND];
    }
    for (i, row) in root.iter().enumerate().rev() {
        let value = solution[i] / row[BAND];
        solution[i] = value;
        let near = BAND.min(i);
        for (other, a) in solution[i - near..i]
            .iter_mut()
            .zip(&row[BAND - near..BAND])
        {
            *other -= a * value;
        }
    }
    solution
}
