//! Normal equations and χ² of blocks of frames, against sums in `f64` of one pixel after the other.

mod naive;

use jotlight::error::{Error, Result};
use jotlight::motion::{
    Counts, EquationsView, Limits, Share, Template, Tested, Totals, accept_agreeing,
    changed_remainders, chi_squared, disagreement, fit_affine, fit_blocks, normal_equations,
};
use jotlight::threads::install;
use ndarray::{Array2, Array3, s};

use crate::on_every_level;
use naive::{Case, naive_chi_squared, naive_equations};

fn assert_close<'a>(
    found: impl IntoIterator<Item = &'a f64>,
    expected: impl IntoIterator<Item = &'a f64> + Clone,
) {
    let scale = expected
        .clone()
        .into_iter()
        .fold(0.0, |max: f64, x| max.max(x.abs()));
    for (found, expected) in found.into_iter().zip(expected) {
        assert!(
            (found - expected).abs() <= 2e-5 * scale + 1e-6,
            "{found} {expected}"
        );
    }
}

const SIZES: [(usize, usize); 6] = [(1, 1), (5, 40), (16, 64), (33, 70), (40, 17), (23, 2850)];

/// Return A, b, and χ² from a number of threads.
fn compute(
    case: &Case,
    sigma: f64,
    threads: usize,
) -> Result<(Array3<f64>, Array3<f64>, Array2<f32>)> {
    install(Some(threads), || {
        let equations = case.equations(sigma)?;
        let mut out = Array2::zeros(case.size());
        chi_squared(&case.comparison(&[case.counts()]), out.view_mut())?;
        Ok((equations.information, equations.right, out))
    })?
}

#[test]
fn equations_and_chi_squared_are_those_of_single_pixels() -> Result<()> {
    for (rows, columns) in SIZES {
        let case = Case::new(rows, columns);
        let chi_squared_of_pixels = naive_chi_squared(&case);
        for sigma in [0.4, 1.0, 3.0] {
            let expected = naive_equations(&case, sigma);
            on_every_level(|_| {
                let found = compute(&case, sigma, 1)?;
                assert_eq!(compute(&case, sigma, 2)?, found);
                assert_eq!(compute(&case, sigma, 3)?, found);
                let (information, right, chi_squared) = found;
                assert_close(&information, expected.slice(s![..3, .., ..]));
                assert_close(&right, expected.slice(s![3.., .., ..]));
                for (found, expected) in chi_squared.iter().zip(&chi_squared_of_pixels) {
                    assert!((f64::from(*found) - expected).abs() <= 1e-4 * expected);
                }
                Ok(())
            })?;
        }
    }
    Ok(())
}

/// Blocks are compared together with others, and added alone.
#[test]
fn counts_that_agree_are_those_below_the_limit_of_the_sum() -> Result<()> {
    on_every_level(|_| accepts_below_the_limit())
}

fn accepts_below_the_limit() -> Result<()> {
    let (case, other, mut sum) = (Case::new(70, 45), Case::new(70, 45), Case::new(70, 45));
    (sum.ones, sum.trials) = (&case.ones + &other.ones, &case.trials + &other.trials);
    let mut expected = Array2::zeros(case.size());
    chi_squared(&sum.comparison(&[sum.counts()]), expected.view_mut())?;
    for (change, is_done) in [(10.0, true), (0.0, false)] {
        let limits = Limits {
            chi_squared: 1.2,
            change,
        };
        let mut counts = [1, 2, 3].map(|start| Array2::from_elem(case.size(), start));
        let mut mask = Array2::from_elem((70, 6), 7);
        let [ones, trials, available] = &mut counts;
        let totals = Totals {
            accepted: [ones.view_mut(), trials.view_mut()],
            available: available.view_mut(),
            masks: vec![mask.view_mut()],
        };
        let tested = [Tested {
            near: vec![other.counts(), case.counts()],
            own: 1,
        }];
        let template = (case.probability.view(), case.of_template.view());
        let found = accept_agreeing(template, limits, &tested, totals)?;
        assert_eq!(found, [is_done]);
        for (place, &test) in expected.indexed_iter() {
            let is_added = is_done && test < 1.2;
            let added = |counts: &Array2<i32>| if is_added { counts[place] } else { 0 };
            assert_eq!(counts[0][place], 1 + added(&case.ones));
            assert_eq!(counts[1][place], 2 + added(&case.trials));
            let seen = if is_done { case.trials[place] } else { 0 };
            assert_eq!(counts[2][place], 3 + seen);
            let bit = mask[[place.0, place.1 / 8]] >> (7 - place.1 % 8) & 1;
            assert!(!is_done || (bit == 1) == is_added);
        }
    }
    Ok(())
}

#[test]
fn blocks_are_fitted_relative_to_the_others() -> Result<()> {
    let case = Case::new(40, 50);
    let template = Template::new(case.probability.view(), case.of_template.view(), 1.0)?;
    let weights = Array2::ones((3, 4));
    let basis = Array2::from_shape_fn((12, 3), |(tile, k)| {
        [1.0, (tile / 4) as f64, (tile % 4) as f64][k]
    });
    let mean = case.trials.mapv(f64::from).mean().unwrap_or_default();
    for (mean_trials, others) in [(4.0 * mean, 0.75), (mean, 0.3)] {
        let share = Share {
            mean_trials,
            min_others: 0.3,
        };
        let blocks = [case.sums(), case.sums()];
        let found = fit_blocks(&template, share, &blocks, weights.view(), basis.view())?;
        let mut equations = case.equations(1.0)?;
        equations.right /= others;
        let view = EquationsView {
            information: equations.information.view(),
            right: equations.right.view(),
        };
        let expected = fit_affine(view, weights.view(), basis.view())?;
        for fit in &found {
            assert_close(&fit.errors, &expected.errors);
            assert_close(&fit.information, &expected.information);
        }
        assert_eq!(found.len(), 2);
    }
    Ok(())
}

#[test]
fn remainders_decrease_by_the_displacements_of_rows() -> Result<()> {
    let remainders = Array3::from_elem((40, 2, 3), 0.5);
    // The displacement of a row is a tenth of its distance from the center of the first tile.
    let change = Array3::from_shape_fn((2, 3, 3), |(k, row, column)| {
        (1.6 * row as f64 + column as f64) * [1.0, -2.0][k]
    });
    let found = changed_remainders(remainders.view(), change.view(), 7)?;
    for ((row, k, column), &value) in found.indexed_iter() {
        let displacement = (0.1 * (row as f64 - 7.5) + column as f64) * [1.0, -2.0][k];
        assert!((f64::from(value) - (0.5 - 7.0 * displacement)).abs() < 1e-4);
    }
    let wrong = changed_remainders(remainders.view(), change.slice(s![.., ..2, ..]), 7);
    assert!(matches!(wrong, Err(Error::Shape { .. })));
    Ok(())
}

#[test]
fn arguments_that_do_not_fit_are_errors() -> Result<()> {
    let case = Case::new(20, 30);
    for sigma in [0.0, -1.0, f64::NAN, 101.0] {
        assert!(matches!(case.equations(sigma), Err(Error::Range { .. })));
    }
    let mut wrong = Case::new(20, 30);
    wrong.probability[[3, 4]] = f32::NAN;
    assert!(matches!(wrong.equations(1.0), Err(Error::Range { .. })));
    let mut out = Array2::zeros((20, 30));
    let result = chi_squared(&wrong.comparison(&[wrong.counts()]), out.view_mut());
    assert!(matches!(result, Err(Error::Range { .. })));
    let mut wrong = Case::new(20, 30);
    wrong.ones[[19, 29]] = wrong.trials[[19, 29]] + 1;
    assert!(matches!(wrong.equations(1.0), Err(Error::Range { .. })));
    let mut wrong = Case::new(20, 30);
    wrong.remainders[[0, 1, 1]] = f32::INFINITY;
    assert!(matches!(wrong.equations(1.0), Err(Error::Range { .. })));
    let mut wrong = Case::new(20, 30);
    wrong.of_template = Array2::zeros((20, 31));
    assert!(matches!(wrong.equations(1.0), Err(Error::Shape { .. })));
    let mut small = Array2::zeros((20, 29));
    let result = chi_squared(&case.comparison(&[case.counts()]), small.view_mut());
    assert!(matches!(result, Err(Error::Shape { .. })));
    let template = Template::new(case.probability.view(), case.of_template.view(), 1.0)?;
    let other = Case::new(20, 31);
    let result = normal_equations(&template, other.sums());
    assert!(matches!(result, Err(Error::Shape { .. })));
    Ok(())
}

#[test]
fn empty_images_are_errors() {
    for (rows, columns) in [(0, 5), (5, 0)] {
        let probability = Array2::<f32>::zeros((rows, columns));
        let trials = Array2::zeros((rows, columns));
        let result = Template::new(probability.view(), trials.view(), 1.0);
        assert!(matches!(result, Err(Error::Range { .. })));
    }
}

#[test]
fn parts_that_do_not_fit_are_errors() -> Result<()> {
    let (case, other) = (Case::new(20, 30), Case::new(20, 31));
    let [first, second] = [&case, &other].map(|case| Counts {
        ones: case.ones.view(),
        trials: case.trials.view(),
    });
    let mut out = Array3::zeros((2, 5, 8));
    disagreement(&first, &first, out.view_mut())?;
    let result = disagreement(&first, &second, out.view_mut());
    assert!(matches!(result, Err(Error::Shape { .. })));
    let mut small = Array3::zeros((2, 5, 7));
    let result = disagreement(&first, &first, small.view_mut());
    assert!(matches!(result, Err(Error::Shape { .. })));
    Ok(())
}
