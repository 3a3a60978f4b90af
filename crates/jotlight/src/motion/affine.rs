//! Robust affine fits to the displacements of tiles.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis};

use super::equations::EquationsView;
use crate::error::{Error, Result};
use crate::numbers::median;
use crate::values::check_not_negative;

/// The number of functions of the place of a tile: 1, its row, and its column.
const FUNCTIONS: usize = 3;

/// The number of coefficients of an affine field.
const COEFFICIENTS: usize = 2 * FUNCTIONS;

/// The number of rounds that reweight the tiles.
const ROUNDS: usize = 5;

/// The information that is added to the coefficients of a fit to equations.
const PRIOR: f64 = 1e-2;

/// The squared deviation, in variances, at which the weight of a tile is a quarter.
const MIN_SCALE: f64 = 9.0;

/// The information that is added to each tile before its own displacement is computed.
const ROUNDING: f64 = 0.5;

/// The smallest median of squared deviations in square pixels by which they are divided.
const MIN_SQUARED_PIXELS: f64 = 0.25;

/// The functions 1, row, and column at each tile.
pub(super) type Basis = [[f64; FUNCTIONS]];

/// An affine field of displacement errors, and the information about its coefficients.
#[derive(Clone, Debug)]
pub struct AffineFit {
    /// The displacement errors, `(2, rows, columns)`.
    pub errors: Array3<f64>,
    /// The information about the coefficients of the functions, first for rows and then for
    /// columns, `(6, 6)`.
    pub information: Array2<f64>,
}

/// Return the affine displacement errors of a segment.
///
/// Tiles that deviate, such as those of other objects, get small weights: (1 + q/c)⁻² with the
/// squared deviation q in units of its variance, and c = max(9, 2 median q). The first weights are
/// those of the deviations from 0.
///
/// `weights` is the fraction of each tile that belongs to the segment, `(rows, columns)`. `basis`
/// holds the functions 1, row, and column at each tile, `(rows · columns, 3)`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if a value is not
/// finite, or a weight is negative.
pub fn fit_affine(
    equations: EquationsView<'_>,
    weights: ArrayView2<'_, f64>,
    basis: ArrayView2<'_, f64>,
) -> Result<AffineFit> {
    let size = equations.check()?;
    if weights.dim() != size {
        return Err(Error::shape("weights of tiles", size, weights.dim()));
    }
    let weights: Vec<f64> = weights.iter().copied().collect();
    check_not_negative("weights of tiles", &weights)?;
    let basis = read_basis(basis, size)?;
    let (information, right) = (
        equations.information_of_tiles(),
        vectors_of_tiles(equations.right),
    );
    let own: Vec<_> = information
        .iter()
        .zip(&right)
        .map(|(&[rows, mixed, columns], &right)| {
            solve_tile([rows + ROUNDING, mixed, columns + ROUNDING], right)
        })
        .collect();
    let mut errors = vec![[0.0; 2]; own.len()];
    let mut matrix = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    for _ in 0..ROUNDS {
        let squared: Vec<f64> = own
            .iter()
            .zip(errors.iter().zip(&information))
            .map(|(own, (error, &[rows, mixed, columns]))| {
                let [x, y] = [own[0] - error[0], own[1] - error[1]];
                rows * x * x + 2.0 * mixed * x * y + columns * y * y
            })
            .collect();
        let trust = robust_weights(&squared, &weights);
        let (found, right) = weighted_sums(&information, &right, &trust, &basis);
        matrix = found;
        let mut with_prior = matrix;
        for (index, row) in with_prior.iter_mut().enumerate() {
            row[index] += PRIOR;
        }
        evaluate(&solve(with_prior, right), &basis, &mut errors);
    }
    let planes = |(direction, row, column)| {
        let error: [f64; 2] = errors[row * size.1 + column];
        error[direction]
    };
    Ok(AffineFit {
        errors: Array3::from_shape_fn((2, size.0, size.1), planes),
        information: Array2::from_shape_fn((COEFFICIENTS, COEFFICIENTS), |(i, j)| matrix[i][j]),
    })
}

/// Return smaller weights for tiles with large squared deviations.
fn robust_weights(squared: &[f64], weights: &[f64]) -> Vec<f64> {
    let pairs = || squared.iter().zip(weights);
    let inside = pairs().filter(|(_, weight)| **weight > 0.0);
    let mut inside: Vec<f64> = inside.map(|(squared, _)| *squared).collect();
    let middle = median(&mut inside).unwrap_or_default();
    let scale = MIN_SCALE.max(2.0 * middle);
    pairs()
        .map(|(squared, weight)| weight / (1.0 + squared / scale).powi(2))
        .collect()
}

/// Return the matrix and the right side of the normal equations of the coefficients.
fn weighted_sums(
    information: &[[f64; 3]],
    right: &[[f64; 2]],
    weights: &[f64],
    basis: &Basis,
) -> ([[f64; COEFFICIENTS]; COEFFICIENTS], [f64; COEFFICIENTS]) {
    let mut sums = [[[0.0; FUNCTIONS]; FUNCTIONS]; 3];
    let mut vector = [0.0; COEFFICIENTS];
    let tiles = information.iter().zip(right).zip(weights.iter().zip(basis));
    for ((information, right), (weight, functions)) in tiles {
        for (sums, entry) in sums.iter_mut().zip(information) {
            for (sums, f) in sums.iter_mut().zip(functions) {
                for (sum, g) in sums.iter_mut().zip(functions) {
                    *sum += weight * entry * f * g;
                }
            }
        }
        for (index, f) in functions.iter().enumerate() {
            vector[index] += weight * right[0] * f;
            vector[FUNCTIONS + index] += weight * right[1] * f;
        }
    }
    let entry =
        |i: usize, j: usize| sums[i / FUNCTIONS + j / FUNCTIONS][i % FUNCTIONS][j % FUNCTIONS];
    let row = |i| std::array::from_fn(|j| entry(i, j));
    (std::array::from_fn(row), vector)
}

/// Write the affine field that is closest to most tiles of `field` into `out`.
///
/// The squared deviation of a tile is weighted by its `trust`, and less if it is large.
pub(super) fn nearest_affine(
    field: &[[f64; 2]],
    trust: &[f64],
    basis: &Basis,
    out: &mut [[f64; 2]],
) {
    let mut weights = trust.to_vec();
    for _ in 0..ROUNDS {
        let mut matrix = [[0.0; FUNCTIONS]; FUNCTIONS];
        let mut right = [[0.0; FUNCTIONS]; 2];
        for ((weight, functions), field) in weights.iter().zip(basis).zip(field) {
            for (index, f) in functions.iter().enumerate() {
                for (sum, g) in matrix[index].iter_mut().zip(functions) {
                    *sum += weight * f * g;
                }
                for (right, field) in right.iter_mut().zip(field) {
                    right[index] += weight * field * f;
                }
            }
        }
        let [rows, columns] = right.map(|right| solve(matrix, right));
        let coefficients = std::array::from_fn(|i| {
            if i < FUNCTIONS {
                rows[i]
            } else {
                columns[i - FUNCTIONS]
            }
        });
        evaluate(&coefficients, basis, out);
        let squared: Vec<f64> = field
            .iter()
            .zip(&*out)
            .map(|(field, affine)| (field[0] - affine[0]).powi(2) + (field[1] - affine[1]).powi(2))
            .collect();
        let middle = median(&mut squared.clone()).unwrap_or_default();
        let scale = middle.max(MIN_SQUARED_PIXELS);
        for ((weight, trust), squared) in weights.iter_mut().zip(trust).zip(&squared) {
            *weight = trust / (1.0 + squared / scale).powi(2);
        }
    }
}

/// Write the affine field with some coefficients into `out`.
fn evaluate(coefficients: &[f64; COEFFICIENTS], basis: &Basis, out: &mut [[f64; 2]]) {
    let (rows, columns) = coefficients.split_at(FUNCTIONS);
    for (out, functions) in out.iter_mut().zip(basis) {
        let value = |coefficients: &[f64]| -> f64 {
            coefficients.iter().zip(functions).map(|(c, f)| c * f).sum()
        };
        *out = [value(rows), value(columns)];
    }
}

/// Return the vector of each tile.
pub(super) fn vectors_of_tiles(vectors: ArrayView3<'_, f64>) -> Vec<[f64; 2]> {
    let [rows, columns] = [0, 1].map(|k| vectors.index_axis_move(Axis(0), k));
    let pairs = rows.iter().zip(&columns);
    pairs.map(|(&row, &column)| [row, column]).collect()
}

/// Return the functions at each tile of a grid.
pub(super) fn read_basis(
    basis: ArrayView2<'_, f64>,
    size: (usize, usize),
) -> Result<Vec<[f64; FUNCTIONS]>> {
    let expected = (size.0 * size.1, FUNCTIONS);
    if basis.dim() != expected {
        return Err(Error::shape("functions of tiles", expected, basis.dim()));
    }
    if let Some(value) = basis.iter().find(|value| !value.is_finite()) {
        return Err(Error::range("functions of tiles", "finite numbers", value));
    }
    let functions = basis.rows().into_iter();
    Ok(functions
        .map(|row| std::array::from_fn(|index| row[index]))
        .collect())
}

/// Return the solution of A e = b of a tile.
pub(super) fn solve_tile([rows, mixed, columns]: [f64; 3], [b, c]: [f64; 2]) -> [f64; 2] {
    let determinant = rows * columns - mixed * mixed;
    [
        (columns * b - mixed * c) / determinant,
        (rows * c - mixed * b) / determinant,
    ]
}

/// Return the solution of linear equations with a symmetric matrix that is not negative.
///
/// Unknowns about which the matrix has no information are 0.
fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut right: [f64; N]) -> [f64; N] {
    const MIN_PIVOT: f64 = 1e-12;
    let scale = (0..N).map(|i| matrix[i][i]).fold(0.0, f64::max);
    let is_known = |pivot: f64| pivot > MIN_PIVOT * scale;
    for k in 0..N {
        if !is_known(matrix[k][k]) {
            continue;
        }
        for i in k + 1..N {
            let factor = matrix[i][k] / matrix[k][k];
            for j in k..N {
                matrix[i][j] -= factor * matrix[k][j];
            }
            right[i] -= factor * right[k];
        }
    }
    let mut solution = [0.0; N];
    for k in (0..N).rev() {
        if is_known(matrix[k][k]) {
            let known: f64 = (k + 1..N).map(|j| matrix[k][j] * solution[j]).sum();
            solution[k] = (right[k] - known) / matrix[k][k];
        }
    }
    solution
}
