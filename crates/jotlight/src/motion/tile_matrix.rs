//! Linear equations of the displacements of all tiles, which conjugate gradients solve.

use super::affine::solve_tile;
use crate::cpu::levels;
use crate::interrupt;

/// The information that is added to each tile, for the predicted displacement.
pub(super) const PRIOR: f64 = 1e-4;

/// The squared norm of the residuals at which the iteration ends, relative to that of the right
/// side.
const TOLERANCE: f64 = 1e-20;

/// The weights of the differences between neighboring tiles.
pub(super) struct Weights {
    columns: usize,
    /// The weights of the differences to the tile on the right; 0 in the last column.
    right: Vec<f64>,
    /// The weights of the differences to the tile below; 0 in the last row.
    below: Vec<f64>,
}

impl Weights {
    /// Return the weights `weight(i, j)` of neighboring tiles with the indices i and j.
    pub fn new((rows, columns): (usize, usize), weight: impl Fn(usize, usize) -> f64) -> Self {
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

    /// Return the sums of the weights.
    pub fn plus(&self, other: &Self) -> Self {
        let add = |one: &[f64], other: &[f64]| one.iter().zip(other).map(|(a, b)| a + b).collect();
        Self {
            columns: self.columns,
            right: add(&self.right, &other.right),
            below: add(&self.below, &other.below),
        }
    }

    /// Add Σ weight · (vector − neighbor) to each vector of `out`.
    pub fn add_differences(&self, vectors: &[[f64; 2]], out: &mut [[f64; 2]]) {
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
pub(super) struct Matrix {
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
    pub fn new(information: &[[f64; 3]], weights: &Weights) -> Self {
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
    pub fn solve(&self, right: &[[f64; 2]], field: &mut [[f64; 2]]) {
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
