//! Affine fits and smooth fields of displacements, against exact fields and a dense solver.

use jotlight::error::{Error, Result};
use jotlight::motion::{AffineFit, EquationsView, Smoothness, Start, fit_affine, solve_field};
use ndarray::{Array1, Array2, Array3};

use crate::on_every_level;
use crate::random::Random;

impl Random {
    fn vectors(&mut self, (rows, columns): (usize, usize)) -> Array3<f64> {
        Array3::from_shape_simple_fn((2, rows, columns), || self.number())
    }

    /// Return information that is not negative. That of every third tile is 0.
    fn information(&mut self, (rows, columns): (usize, usize), scale: f64) -> Array3<f64> {
        let mut information = Array3::zeros((3, rows, columns));
        for tile in (0..rows * columns).filter(|tile| tile % 3 > 0) {
            let (row, column) = (tile / columns, tile % columns);
            for _ in 0..3 {
                let [x, y] = [self.number(), self.number()];
                for (entry, value) in [x * x, x * y, y * y].into_iter().enumerate() {
                    information[[entry, row, column]] += scale * value;
                }
            }
        }
        information
    }
}

fn basis((rows, columns): (usize, usize)) -> Array2<f64> {
    Array2::from_shape_fn((rows * columns, 3), |(tile, function)| match function {
        0 => 1.0,
        1 => (tile / columns) as f64 / rows as f64 - 0.5,
        _ => (tile % columns) as f64 / columns as f64 - 0.5,
    })
}

/// Return A times vectors.
fn product(information: &Array3<f64>, vectors: &Array3<f64>) -> Array3<f64> {
    Array3::from_shape_fn(vectors.dim(), |(direction, row, column)| {
        information[[direction, row, column]] * vectors[[0, row, column]]
            + information[[direction + 1, row, column]] * vectors[[1, row, column]]
    })
}

fn view<'a>(information: &'a Array3<f64>, right: &'a Array3<f64>) -> EquationsView<'a> {
    EquationsView {
        information: information.view(),
        right: right.view(),
    }
}

/// Return the solution of linear equations by elimination.
fn solve_dense(mut matrix: Array2<f64>, mut right: Array1<f64>) -> Array1<f64> {
    let number = right.len();
    for k in 0..number {
        for i in k + 1..number {
            let factor = matrix[[i, k]] / matrix[[k, k]];
            for j in k..number {
                matrix[[i, j]] -= factor * matrix[[k, j]];
            }
            right[i] -= factor * right[k];
        }
    }
    for k in (0..number).rev() {
        for j in k + 1..number {
            right[k] -= matrix[[k, j]] * right[j];
        }
        right[k] /= matrix[[k, k]];
    }
    right
}

const SIZES: [(usize, usize); 4] = [(1, 1), (1, 6), (4, 4), (7, 5)];

#[test]
fn affine_errors_are_found_despite_an_object() -> Result<()> {
    let size = (8, 9);
    let (basis, mut random) = (basis(size), Random(3));
    let coefficients = [[0.5, -0.7, 0.3], [-0.2, 0.1, 0.9]];
    let mut errors = Array3::from_shape_fn((2, size.0, size.1), |(direction, row, column)| {
        let functions = basis.row(row * size.1 + column);
        functions
            .iter()
            .zip(coefficients[direction])
            .map(|(f, c)| f * c)
            .sum::<f64>()
    });
    let information = random.information(size, 1e4);
    let weights = Array2::ones(size);
    let expected = errors.clone();
    for row in 2..4 {
        for column in 3..6 {
            errors[[0, row, column]] += 5.0;
        }
    }
    let right = product(&information, &errors);
    let fit = fit_affine(view(&information, &right), weights.view(), basis.view())?;
    for (found, expected) in fit.errors.iter().zip(&expected) {
        assert!((found - expected).abs() < 0.01);
    }
    for (entry, mirrored) in fit.information.iter().zip(fit.information.t()) {
        assert!((entry - mirrored).abs() <= 1e-9 * fit.information[[0, 0]]);
    }
    let nowhere = Array2::zeros(size);
    let fit = fit_affine(view(&information, &right), nowhere.view(), basis.view())?;
    assert!(fit.errors.iter().all(|&error| error == 0.0));
    Ok(())
}

#[test]
fn fields_solve_the_equations_on_every_level() -> Result<()> {
    for size in SIZES {
        let (mut random, tiles) = (Random(4), size.0 * size.1);
        let information = random.information(size, 30.0);
        let [right, now, predicted] = [(); 3].map(|()| random.vectors(size));
        // So small a weight of the affine field changes nothing, and the equations are linear.
        let smoothness = Smoothness {
            to_prediction: 3.0,
            to_affine: 1e-12,
            outline: 0.5,
        };
        let mut matrix = Array2::<f64>::eye(2 * tiles) * 1e-4;
        for i in 0..tiles {
            let place = [i / size.1, i % size.1];
            for (a, b, entry) in [(0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)] {
                let index = [a * tiles + i, b * tiles + i];
                matrix[index] += information[[entry, place[0], place[1]]];
            }
            let neighbors = [
                (place[1] + 1 < size.1, i + 1),
                (place[0] + 1 < size.0, i + size.1),
            ];
            for (_, j) in neighbors.into_iter().filter(|(exists, _)| *exists) {
                for offset in [0, tiles] {
                    let (i, j) = (i + offset, j + offset);
                    matrix[[i, i]] += smoothness.to_prediction;
                    matrix[[j, j]] += smoothness.to_prediction;
                    matrix[[i, j]] -= smoothness.to_prediction;
                    matrix[[j, i]] -= smoothness.to_prediction;
                }
            }
        }
        // The unknowns are the deviations from the prediction.
        let data = product(&information, &(&now - &predicted)) - &right;
        let data = Array1::from_iter(data.iter().copied());
        let deviations = solve_dense(matrix, data);
        let start = Start {
            now: now.view(),
            predicted: predicted.view(),
        };
        on_every_level(|_| {
            let equations = view(&information, &right);
            let field = solve_field(equations, start, basis(size).view(), smoothness)?;
            let expected = predicted.iter().zip(&deviations).map(|(a, b)| a + b);
            for (found, expected) in field.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            }
            Ok(())
        })?;
    }
    Ok(())
}

fn fit(
    information: &Array3<f64>,
    right: &Array3<f64>,
    weights: &Array2<f64>,
    basis: &Array2<f64>,
) -> Result<AffineFit> {
    fit_affine(view(information, right), weights.view(), basis.view())
}

#[test]
fn arguments_that_do_not_fit_are_errors() {
    let (information, right) = (Array3::ones((3, 3, 4)), Array3::zeros((2, 3, 4)));
    let (weights, functions) = (Array2::ones((3, 4)), basis((3, 4)));
    assert!(fit(&information, &right, &weights, &functions).is_ok());
    let is_shape = |result| matches!(result, Err(Error::Shape { .. }));
    let is_range = |result| matches!(result, Err(Error::Range { .. }));
    let wide = Array3::ones((3, 3, 5));
    assert!(is_shape(fit(&wide, &right, &weights, &functions)));
    let planes = Array3::zeros((3, 3, 4));
    assert!(is_shape(fit(&information, &planes, &weights, &functions)));
    let high = Array2::ones((4, 4));
    assert!(is_shape(fit(&information, &right, &high, &functions)));
    let few = basis((3, 3));
    assert!(is_shape(fit(&information, &right, &weights, &few)));
    let unknown = &information * f64::NAN;
    assert!(is_range(fit(&unknown, &right, &weights, &functions)));
    let negative = -&weights;
    assert!(is_range(fit(&information, &right, &negative, &functions)));
    let (no_rows, no_right) = (Array3::ones((3, 0, 4)), Array3::zeros((2, 0, 4)));
    assert!(is_shape(fit(&no_rows, &no_right, &weights, &functions)));
}
