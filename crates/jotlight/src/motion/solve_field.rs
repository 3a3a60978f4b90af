//! Smooth fields of displacements from the normal equations of all tiles.

use ndarray::{Array3, ArrayView2, ArrayView3};

use super::affine::{nearest_affine, read_basis, vectors_of_tiles};
use super::equations::EquationsView;
use super::tile_matrix::{Matrix, PRIOR, Weights};
use crate::error::{Error, Result};
use crate::values::{check_not_negative, check_positive};

/// The factors of λ2 in the rounds that reweight the differences of neighbors.
const REWEIGHTINGS: [f64; 3] = [0.1, 1.0, 1.0];

/// The information that is added to the trust in a tile.
const MIN_TRUST: f64 = 1e-3;

/// How similar the displacements of neighboring tiles are.
#[derive(Clone, Copy, Debug)]
pub struct Smoothness {
    /// λ1: the weight of the squared differences of neighbors' deviations from a prediction.
    pub to_prediction: f64,
    /// λ2: the weight of the squared differences of neighbors' deviations from an affine field.
    pub to_affine: f64,
    /// ρ: the difference in pixels above which neighbors probably belong to different objects.
    pub outline: f64,
}

/// Displacements of all tiles, `(2, rows, columns)`, from which a better field is computed.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// The displacements of the equations.
    pub now: ArrayView3<'a, f64>,
    /// The predicted displacements.
    pub predicted: ArrayView3<'a, f64>,
}

/// Return the smooth field of displacements u, `(2, rows, columns)`, that fits the equations.
///
/// It minimizes ½ dᵀA d − bᵀd + ½ λ1 Σ |∇(u − predicted)|² + ½ Σ w |∇(u − affine)|² with
/// d = now − u. Here ∇ is the difference of neighboring tiles, `affine` is the robust affine fit to
/// u, and w = λ2 / (1 + |∇(u − affine)|²/ρ²). Conjugate gradients solve the linear equations.
///
/// `basis` holds the functions 1, row, and column at each tile, `(rows · columns, 3)`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if a value is not
/// finite, a weight is negative, or ρ is not positive.
pub fn solve_field(
    equations: EquationsView<'_>,
    start: Start<'_>,
    basis: ArrayView2<'_, f64>,
    smoothness: Smoothness,
) -> Result<Array3<f64>> {
    let size = equations.check()?;
    let basis = read_basis(basis, size)?;
    check(start, size, smoothness)?;
    let information = equations.information_of_tiles();
    let now = vectors_of_tiles(start.now);
    let predicted = vectors_of_tiles(start.predicted);
    let right = vectors_of_tiles(equations.right);
    let data: Vec<_> = right
        .iter()
        .zip(information.iter().zip(&now))
        .map(|(right, (&[rows, mixed, columns], now))| {
            [
                rows * now[0] + mixed * now[1] - right[0],
                mixed * now[0] + columns * now[1] - right[1],
            ]
        })
        .collect();
    let trust: Vec<f64> = information
        .iter()
        .map(|[rows, _, columns]| rows + columns + MIN_TRUST)
        .collect();
    let mut field = now;
    let mut affine = vec![[0.0; 2]; field.len()];
    let to_prediction = Weights::new(size, |_, _| smoothness.to_prediction);
    for factor in REWEIGHTINGS {
        nearest_affine(&field, &trust, &basis, &mut affine);
        let to_affine = Weights::new(size, |i, j| {
            let change =
                [0, 1].map(|k| (field[i][k] - affine[i][k]) - (field[j][k] - affine[j][k]));
            let squared = change[0] * change[0] + change[1] * change[1];
            factor * smoothness.to_affine / (1.0 + squared / smoothness.outline.powi(2))
        });
        let mut right = data.clone();
        to_prediction.add_differences(&predicted, &mut right);
        to_affine.add_differences(&affine, &mut right);
        for (right, predicted) in right.iter_mut().zip(&predicted) {
            for (right, predicted) in right.iter_mut().zip(predicted) {
                *right += PRIOR * predicted;
            }
        }
        let matrix = Matrix::new(&information, &to_affine.plus(&to_prediction));
        matrix.solve(&right, &mut field);
    }
    Ok(Array3::from_shape_fn(
        (2, size.0, size.1),
        |(direction, row, column)| field[row * size.1 + column][direction],
    ))
}

fn check(start: Start<'_>, size: (usize, usize), smoothness: Smoothness) -> Result<()> {
    let shape = (2, size.0, size.1);
    for (what, vectors) in [
        ("displacements", start.now),
        ("predicted displacements", start.predicted),
    ] {
        if vectors.dim() != shape {
            return Err(Error::shape(what, shape, vectors.dim()));
        }
        if let Some(value) = vectors.iter().find(|value| !value.is_finite()) {
            return Err(Error::range(what, "finite numbers", value));
        }
    }
    let Smoothness {
        to_prediction,
        to_affine,
        outline,
    } = smoothness;
    check_not_negative("weights of differences", &[to_prediction, to_affine])?;
    check_positive("difference at outlines", outline)
}
