//! Smooth fields of displacements from the normal equations of all tiles.

use ndarray::{Array3, ArrayView2, ArrayView3};

use super::affine::{nearest_affine, read_basis, solve_tile, vectors_of_tiles};
use super::equations::EquationsView;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// The factors of λ2 in the rounds that reweight the differences of neighbors.
const REWEIGHTINGS: [f64; 3] = [0.1, 1.0, 1.0];

/// The information that is added to each tile, for the predicted displacement.
const PRIOR: f64 = 1e-4;

/// The information that is added to the trust in a tile.
const MIN_TRUST: f64 = 1e-3;

/// The squared norm of the residuals at which the iteration ends, relative to that of the right
/// side.
const TOLERANCE: f64 = 1e-20;

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
    for weight in [to_prediction, to_affine] {
        if !(weight >= 0.0 && weight.is_finite()) {
            let expected = "finite numbers of at least 0";
            return Err(Error::range("weights of differences", expected, weight));
        }
    }
    if !(outline > 0.0 && outline.is_finite()) {
        return Err(Error::range(
            "difference at outlines",
            "a positive number",
            outline,
        ));
    }
    Ok(())
}

/// The weights of the differences between neighboring tiles.
struct Weights {
    columns: usize,
    /// The weights of the differences to the tile on the right; 0 in the last column.
    right: Vec<f64>,
    /// The weights of the differences to the tile below; 0 in the last row.
    below: Vec<f64>,
}

impl Weights {
    /// Return the weights `weight(i, j)` of neighboring tiles with the indices i and j.
    fn new((rows, columns): (usize, usize), weight: impl Fn(usize, usize) -> f64) -> Self {
        let tiles = 0..rows * columns;
        let is_last = |i: usize| i % columns + 1 == columns;
        let right = tiles
            .clone()
            .map(|i| if is_last(i) { 0.0 } else { weight(i, i + 1) });
        let inner = (rows - 1) * columns;
        let below = tiles.map(|i| {
            if i < inner {
                weight(i, i + columns)
            } else {
                0.0
            }
        });
        Self {
            columns,
            right: right.collect(),
            below: below.collect(),
        }
    }

    fn plus(&self, other: &Self) -> Self {
        let add = |one: &[f64], other: &[f64]| one.iter().zip(other).map(|(a, b)| a + b).collect();
        Self {
            columns: self.columns,
            right: add(&self.right, &other.right),
            below: add(&self.below, &other.below),
        }
    }

    /// Add Σ weight · (vector − neighbor) to each vector of `out`.
    fn add_differences(&self, vectors: &[[f64; 2]], out: &mut [[f64; 2]]) {
        for (step, weights) in [(1, &self.right), (self.columns, &self.below)] {
            for i in 0..vectors.len().saturating_sub(step) {
                for k in 0..2 {
                    let difference = weights[i] * (vectors[i][k] - vectors[i + step][k]);
                    out[i][k] += difference;
                    out[i + step][k] -= difference;
                }
            }
        }
    }
}

/// Vectors of all tiles: a plane for rows and one for columns. Before and after the tiles, there is
/// a row of zeros, so that each tile has neighbors.
type Planes = [Vec<f64>; 2];

/// The matrix of the linear equations. All its vectors are padded like [`Planes`].
struct Matrix {
    columns: usize,
    /// The weights of the neighbors on the left, on the right, above, and below.
    neighbors: [Vec<f64>; 4],
    /// The entries of each tile for itself: for rows, for rows and columns, and for columns.
    own: [Vec<f64>; 3],
    /// The inverse of these entries.
    inverse: [Vec<f64>; 3],
}

impl Matrix {
    /// Return the matrix of the information about all tiles, and the weights of differences.
    fn new(information: &[[f64; 3]], weights: &Weights) -> Self {
        let (tiles, columns) = (information.len(), weights.columns);
        let plane = || vec![0.0; tiles + 2 * columns];
        let mut matrix = Self {
            columns,
            neighbors: [(); 4].map(|()| plane()),
            own: [(); 3].map(|()| plane()),
            inverse: [(); 3].map(|()| plane()),
        };
        let [left, right, above, below] = &mut matrix.neighbors;
        for i in 0..tiles {
            right[i + columns] = weights.right[i];
            left[i + columns + 1] = weights.right[i];
            below[i + columns] = weights.below[i];
            above[i + 2 * columns] = weights.below[i];
        }
        for (i, &[rows, mixed, columns_entry]) in information.iter().enumerate() {
            let index = i + columns;
            let sum: f64 = matrix.neighbors.iter().map(|weights| weights[index]).sum();
            let own = [rows + sum + PRIOR, mixed, columns_entry + sum + PRIOR];
            let [a, c] = [[1.0, 0.0], [0.0, 1.0]].map(|unit| solve_tile(own, unit));
            for (entry, (own, inverse)) in own.into_iter().zip([a[0], a[1], c[1]]).enumerate() {
                matrix.own[entry][index] = own;
                matrix.inverse[entry][index] = inverse;
            }
        }
        matrix
    }

    /// Replace `field` with the solution of the equations, by conjugate gradients.
    fn solve(&self, right: &[[f64; 2]], field: &mut [[f64; 2]]) {
        let pad = |vectors: &[[f64; 2]]| {
            [0, 1].map(|k| {
                let mut plane = vec![0.0; self.own[0].len()];
                for (out, vector) in plane[self.columns..].iter_mut().zip(vectors) {
                    *out = vector[k];
                }
                plane
            })
        };
        let mut x = pad(field);
        iterate(self, &pad(right), &mut x);
        for (i, vector) in field.iter_mut().enumerate() {
            *vector = [0, 1].map(|k| x[k][i + self.columns]);
        }
    }

    /// Write the product with `vectors` into `out`.
    #[inline(always)]
    fn multiply(&self, vectors: &Planes, out: &mut Planes) {
        let (columns, tiles) = (self.columns, out[0].len() - 2 * self.columns);
        for k in 0..2 {
            multiply_plane(
                [&self.own[2 * k], &self.own[1]].map(|plane| &plane[columns..][..tiles]),
                self.neighbors
                    .each_ref()
                    .map(|plane| &plane[columns..][..tiles]),
                &vectors[k],
                &vectors[1 - k][columns..][..tiles],
                &mut out[k][columns..][..tiles],
            );
        }
    }

    /// Write the products with the inverses of the entries of each tile for itself into `out`.
    #[inline(always)]
    fn multiply_inverses(&self, vectors: &Planes, out: &mut Planes) {
        let [rows, mixed, columns] = &self.inverse;
        let [out_rows, out_columns] = out;
        for i in 0..rows.len() {
            let vector = [vectors[0][i], vectors[1][i]];
            out_rows[i] = rows[i] * vector[0] + mixed[i] * vector[1];
            out_columns[i] = mixed[i] * vector[0] + columns[i] * vector[1];
        }
    }
}

/// Write a plane of the product of a matrix with vectors into `out`.
///
/// `own` holds the entries of each tile for this plane and the other plane, and `padded` is this
/// plane of the vectors with its padding.
#[inline(always)]
fn multiply_plane(
    own: [&[f64]; 2],
    neighbors: [&[f64]; 4],
    padded: &[f64],
    other: &[f64],
    out: &mut [f64],
) {
    let tiles = out.len();
    let columns = (padded.len() - tiles) / 2;
    let at = |offset: usize| &padded[offset..][..tiles];
    let (middle, left, right) = (at(columns), at(columns - 1), at(columns + 1));
    let (above, below) = (at(0), at(2 * columns));
    for i in 0..tiles {
        let near = neighbors[0][i] * left[i] + neighbors[1][i] * right[i];
        let far = neighbors[2][i] * above[i] + neighbors[3][i] * below[i];
        out[i] = own[0][i] * middle[i] + own[1][i] * other[i] - near - far;
    }
}

levels! {
    /// Improve `x` until it solves the equations with the right side `right`.
    fn iterate(matrix: &Matrix, right: &Planes, x: &mut Planes) = iterate_inlined;
}

#[inline(always)]
fn iterate_inlined(matrix: &Matrix, right: &Planes, x: &mut Planes) {
    let zeros = || [(); 2].map(|()| vec![0.0; right[0].len()]);
    let (mut product, mut scaled) = (zeros(), zeros());
    matrix.multiply_inverses(right, &mut scaled);
    let end = TOLERANCE * dot(right, &scaled);
    matrix.multiply(x, &mut product);
    let mut residual = right.clone();
    add_multiple(&mut residual, -1.0, &product);
    matrix.multiply_inverses(&residual, &mut scaled);
    let mut direction = scaled.clone();
    let mut squared = dot(&residual, &scaled);
    // Without rounding errors, one step per unknown finds the solution.
    for _ in 0..4 * right[0].len() {
        if squared <= end || interrupt::is_requested() {
            return;
        }
        matrix.multiply(&direction, &mut product);
        let step = squared / dot(&direction, &product);
        add_multiple(x, step, &direction);
        add_multiple(&mut residual, -step, &product);
        matrix.multiply_inverses(&residual, &mut scaled);
        let ratio = dot(&residual, &scaled) / squared;
        squared *= ratio;
        for (direction, scaled) in direction.iter_mut().zip(&scaled) {
            for (direction, scaled) in direction.iter_mut().zip(scaled) {
                *direction = scaled + ratio * *direction;
            }
        }
    }
}

#[inline(always)]
fn add_multiple(sum: &mut Planes, factor: f64, planes: &Planes) {
    for (sum, plane) in sum.iter_mut().zip(planes) {
        for (sum, value) in sum.iter_mut().zip(plane) {
            *sum += factor * value;
        }
    }
}

/// Return the inner product. Several sums at a time let the compiler vectorize it.
#[inline(always)]
fn dot(one: &Planes, other: &Planes) -> f64 {
    const LANES: usize = 16;
    let mut sums = [0.0; LANES];
    let mut rest = 0.0;
    for (one, other) in one.iter().zip(other) {
        let (one, one_rest) = one.as_chunks::<LANES>();
        let (other, other_rest) = other.as_chunks::<LANES>();
        for (one, other) in one.iter().zip(other) {
            for lane in 0..LANES {
                sums[lane] += one[lane] * other[lane];
            }
        }
        rest += one_rest
            .iter()
            .zip(other_rest)
            .map(|(a, b)| a * b)
            .sum::<f64>();
    }
    sums.iter().sum::<f64>() + rest
}
