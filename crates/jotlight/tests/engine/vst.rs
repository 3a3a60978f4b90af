//! Comparisons of the Anscombe transform with its inverses, and of its expectation with a sum.

use jotlight::error::Result;
use jotlight::values::Values;
use jotlight::vst::{Anscombe, ExactInverse, algebraic_inverse, map, map_with_trials, transform};
use ndarray::Array1;

#[test]
fn the_algebraic_inverse_restores_counts() {
    for trials in [0.3, 1.0, 2.5, 16.0, 255.0, 65_536.0] {
        for step in 0..=20 {
            let count = trials * f64::from(step) / 20.0;
            let restored = algebraic_inverse(transform(count, trials), trials);
            assert!(
                (restored - count).abs() < 1e-9 * trials,
                "K = {trials}, {count}"
            );
        }
        assert_eq!(algebraic_inverse(-1.0, trials).to_bits(), 0);
        assert!((algebraic_inverse(1e6, trials) - trials).abs() < 1e-9);
    }
}

#[test]
fn the_algebraic_inverse_of_no_number_is_none() {
    for (z, trials) in [(1.0, -1.0), (1.0, -0.5), (1.0, f64::NAN), (f64::NAN, 4.0)] {
        assert!(algebraic_inverse(z, trials).is_nan(), "K = {trials}, {z}");
    }
    assert_eq!(algebraic_inverse(1.0, 0.0).to_bits(), 0);
}

#[test]
fn the_expectation_is_a_binomial_sum() -> Result<()> {
    for bits in [1, 4, 25] {
        let anscombe = Anscombe::new(bits)?;
        for p in [0.01, 0.3, 0.5, 0.97] {
            let (mut binomial, mut expected) = (1.0, 0.0);
            for count in 0..=bits {
                let weight = f64::powi(p, count as i32) * f64::powi(1.0 - p, (bits - count) as i32);
                expected += binomial * weight * anscombe.transform(f64::from(count));
                binomial *= f64::from(bits - count) / f64::from(count + 1);
            }
            assert!(
                (anscombe.expectation(p) - expected).abs() < 1e-12 * expected,
                "K = {bits}"
            );
        }
    }
    Ok(())
}

#[test]
fn the_exact_inverse_restores_the_expected_count() -> Result<()> {
    for bits in [1, 4, 16, 100] {
        let (anscombe, exact) = (Anscombe::new(bits)?, ExactInverse::new(bits)?);
        for step in 1..100 {
            let p = f64::from(step) / 100.0;
            let count = exact.inverse(anscombe.expectation(p));
            assert!(
                (count - f64::from(bits) * p).abs() < 1e-6 * f64::from(bits),
                "K = {bits}"
            );
        }
        assert_eq!(exact.inverse(-1.0).to_bits(), 0);
        assert!((exact.inverse(1e9) - f64::from(bits)).abs() < 1e-12);
    }
    Ok(())
}

#[test]
fn invalid_arguments_are_errors() {
    assert!(Anscombe::new(0).is_err());
    assert!(ExactInverse::new(0).is_err());
    let (values, mut out) = (Array1::zeros(3), Array1::zeros(4));
    assert!(map(values.view(), out.view_mut(), |x| x).is_err());
    for trials in [-1.0, f64::NAN, f64::INFINITY] {
        for trials in [Values::Same(trials), Values::Each(&[1.0, 1.0, trials])] {
            let mut out = Array1::zeros(3);
            assert!(map_with_trials(values.view(), trials, out.view_mut(), transform).is_err());
        }
    }
    let three = Values::Each(&[1.0; 3][..]);
    assert!(map_with_trials(values.view(), three, out.view_mut(), transform).is_err());
    let two = Values::Each(&[1.0; 2][..]);
    assert!(map_with_trials(values.view(), two, Array1::zeros(3).view_mut(), transform).is_err());
}

#[test]
fn each_value_may_have_its_own_trials() -> Result<()> {
    let length = 3000;
    let trials: Vec<f64> = (0..length).map(|i| f64::from(i % 37) / 3.0).collect();
    let values: Array1<f32> = trials.iter().map(|trials| (trials / 2.0) as f32).collect();
    let mut out = Array1::zeros(values.len());
    map_with_trials(
        values.view(),
        Values::Each(&trials),
        out.view_mut(),
        transform,
    )?;
    for ((&value, &trials), &out) in values.iter().zip(&trials).zip(&out) {
        let expected = transform(f64::from(value), trials);
        assert!((f64::from(out) - expected).abs() < 1e-6);
    }
    Ok(())
}

#[test]
fn the_exact_inverse_restores_rare_counts_of_many_readings() -> Result<()> {
    for bits in [100_000, 10_000_000] {
        let (anscombe, exact) = (Anscombe::new(bits)?, ExactInverse::new(bits)?);
        let largest = std::f64::consts::FRAC_PI_2 * (f64::from(bits) + 0.5).sqrt();
        for rare in [0.01, 0.3, 1.0, 10.0, 150.0, 1000.0] {
            let z = anscombe.expectation(rare / f64::from(bits));
            let errors = [
                exact.inverse(z) - rare,
                exact.inverse(largest - z) - (f64::from(bits) - rare),
            ];
            for error in errors {
                assert!(error.abs() < 0.01, "K = {bits}, {rare}: {error}");
            }
        }
    }
    Ok(())
}
