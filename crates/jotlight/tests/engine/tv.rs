//! Comparisons of the total variation, its adjoint, and its proximal map with their definitions.

use jotlight::admm::AdmmStep;
use jotlight::error::Result;
use jotlight::tv::{self, Norm};
use jotlight::values::Values;
use ndarray::{Array2, Array3, Array4, ArrayView, ArrayViewMut, Axis, Dimension, concatenate, s};

const NORMS: [Norm; 2] = [Norm::Isotropic, Norm::Anisotropic];

fn test_image() -> Array2<f64> {
    Array2::from_shape_fn((7, 5), |(row, column)| {
        (1.7 * row as f64 + 0.9 * (column * column) as f64).sin()
    })
}

fn test_differences() -> Array3<f64> {
    Array3::from_shape_fn((2, 7, 5), |(direction, row, column)| {
        (2.3 * direction as f64 + 0.7 * row as f64 - 1.1 * column as f64).cos()
    })
}

/// Return a stack of one array.
fn one<T, D: Dimension>(array: ArrayView<'_, T, D>) -> ArrayView<'_, T, D::Larger> {
    array.insert_axis(Axis(0))
}

fn one_mut<T, D: Dimension>(array: ArrayViewMut<'_, T, D>) -> ArrayViewMut<'_, T, D::Larger> {
    array.insert_axis(Axis(0))
}

fn magnitude(norm: Norm, down: f64, right: f64) -> f64 {
    match norm {
        Norm::Isotropic => down.hypot(right),
        Norm::Anisotropic => down.abs() + right.abs(),
    }
}

#[test]
fn differences_have_an_exact_adjoint() -> Result<()> {
    let (image, y) = (test_image(), test_differences());
    let (mut forward, mut adjoint) = (Array3::zeros((2, 7, 5)), Array2::zeros((7, 5)));
    tv::differences(one(image.view()), one_mut(forward.view_mut()))?;
    tv::adjoint(one(y.view()), one_mut(adjoint.view_mut()))?;
    let (left, right) = ((&forward * &y).sum(), (&image * &adjoint).sum());
    assert!((left - right).abs() < 1e-12 * left.abs());
    assert!((forward[[0, 2, 3]] - (image[[3, 3]] - image[[2, 3]])).abs() < 1e-15);
    assert!((forward[[1, 2, 3]] - (image[[2, 4]] - image[[2, 3]])).abs() < 1e-15);
    assert!(
        forward
            .index_axis(ndarray::Axis(0), 0)
            .row(6)
            .iter()
            .all(|&x| x == 0.0)
    );
    assert!(
        forward
            .index_axis(ndarray::Axis(0), 1)
            .column(4)
            .iter()
            .all(|&x| x == 0.0)
    );
    Ok(())
}

#[test]
fn the_total_is_a_weighted_sum_of_norms() -> Result<()> {
    let (differences, weight) = (test_differences(), vec![0.5; 35]);
    for norm in NORMS {
        let mut expected = 0.0;
        for row in 0..7 {
            for column in 0..5 {
                let (down, right) = (differences[[0, row, column]], differences[[1, row, column]]);
                expected += 0.5 * magnitude(norm, down, right);
            }
        }
        for weight in [Values::Same(0.5), Values::Each(&weight)] {
            let total = tv::total_variation(one(differences.view()), weight, norm)?[0];
            assert!((total - expected).abs() < 1e-12 * expected);
        }
    }
    Ok(())
}

#[test]
fn the_shrunk_differences_minimize_the_objective() -> Result<()> {
    let original = test_differences();
    for norm in NORMS {
        let mut shrunk = original.clone();
        tv::shrink(one_mut(shrunk.view_mut()), Values::Same(0.4), norm)?;
        for row in 0..7 {
            for column in 0..5 {
                let pair = |array: &Array3<f64>| (array[[0, row, column]], array[[1, row, column]]);
                let ((a, b), (down, right)) = (pair(&original), pair(&shrunk));
                let objective = |down: f64, right: f64| {
                    let distance = (down - a).powi(2) + (right - b).powi(2);
                    0.4 * magnitude(norm, down, right) + 0.5 * distance
                };
                let minimum = objective(down, right);
                for (x, y) in [(1e-3, 0.0), (-1e-3, 0.0), (0.0, 1e-3), (0.0, -1e-3)] {
                    assert!(objective(down + x, right + y) > minimum, "{norm:?}");
                }
            }
        }
    }
    Ok(())
}

#[test]
fn an_admm_update_is_a_proximal_map_and_a_dual_step() -> Result<()> {
    let image = test_image();
    let step = AdmmStep {
        penalty: 0.8,
        relaxation: 1.5,
    };
    for norm in NORMS {
        let (mut x, mut dual) = (test_differences(), 0.3 * test_differences());
        let mut differences = Array3::zeros((2, 7, 5));
        tv::differences(one(image.view()), one_mut(differences.view_mut()))?;
        let point = 1.5 * &differences - 0.5 * &x + &dual;
        let mut expected = point.clone();
        tv::shrink(one_mut(expected.view_mut()), Values::Same(0.2 / 0.8), norm)?;
        let (weight, view) = (Values::Same(0.2), one(image.view()));
        let states = (one_mut(x.view_mut()), one_mut(dual.view_mut()));
        let residual = tv::admm_update(&[step], weight, norm, view, states.0, states.1)?[0];
        assert!((&x - &expected).iter().all(|error| error.abs() < 1e-12));
        assert!(
            (&dual - &(&point - &x))
                .iter()
                .all(|error| error.abs() < 1e-12)
        );
        let squares = (&differences - &x).mapv(|error| error * error).sum();
        assert!((residual - squares).abs() < 1e-12 * squares);
    }
    Ok(())
}

#[test]
fn invalid_arguments_are_errors() {
    let mut differences = test_differences();
    for threshold in [-0.1, f64::NAN] {
        let shrunk = tv::shrink(
            one_mut(differences.view_mut()),
            Values::Same(threshold),
            Norm::Isotropic,
        );
        assert!(shrunk.is_err());
    }
    let weight = Values::Each(&[1.0; 3][..]);
    assert!(tv::total_variation(one(differences.view()), weight, Norm::Isotropic).is_err());
    let image = test_image();
    assert!(tv::differences(one(image.view()), Array4::zeros((1, 2, 7, 4)).view_mut()).is_err());
    assert!(tv::adjoint(one(differences.view()), Array3::zeros((1, 0, 5)).view_mut()).is_err());
}

/// Each image of a stack has its own weights and its own step.
#[test]
fn the_images_of_a_stack_are_independent() -> Result<()> {
    let (first, second) = (test_image(), 0.5 * test_image() + 0.25);
    let images = concatenate![Axis(0), one(first.view()), one(second.view())];
    let weights: Vec<f64> = (0..70).map(|index| 0.01 * f64::from(index)).collect();
    let step = |penalty| AdmmStep {
        penalty,
        relaxation: 1.2,
    };
    let steps = [step(0.8), step(0.3)];
    for norm in NORMS {
        let all = Values::Each(&weights);
        let mut differences = Array4::zeros((2, 2, 7, 5));
        tv::differences(images.view(), differences.view_mut())?;
        let totals = tv::total_variation(differences.view(), all, norm)?;
        let (mut x, mut dual) = (0.5 * &differences, 0.1 * &differences);
        let residuals = tv::admm_update(
            &steps,
            all,
            norm,
            images.view(),
            x.view_mut(),
            dual.view_mut(),
        )?;
        for image in 0..2 {
            let part = image..image + 1;
            let own = Values::Each(&weights[35 * image..35 * (image + 1)]);
            let differences = differences.slice(s![part.clone(), .., .., ..]);
            let total = tv::total_variation(differences, own, norm)?;
            assert_eq!(total[0].to_bits(), totals[image].to_bits());
            let view = images.slice(s![part.clone(), .., ..]);
            let (mut own_x, mut own_dual) = (0.5 * &differences, 0.1 * &differences);
            let states = (own_x.view_mut(), own_dual.view_mut());
            let residual =
                tv::admm_update(&steps[part.clone()], own, norm, view, states.0, states.1)?;
            assert_eq!(residual[0].to_bits(), residuals[image].to_bits());
            assert_eq!(own_x, x.slice(s![part.clone(), .., .., ..]));
            assert_eq!(own_dual, dual.slice(s![part, .., .., ..]));
        }
    }
    let mut few = Array4::zeros((1, 2, 7, 5));
    assert!(tv::differences(images.view(), few.view_mut()).is_err());
    Ok(())
}
