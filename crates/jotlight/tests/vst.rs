//! Comparisons of the Anscombe transform with its inverses, and of its expectation with a sum.

use jotlight::error::Result;
use jotlight::vst::{Anscombe, ExactInverse, map};
use ndarray::Array1;

#[test]
fn the_algebraic_inverse_restores_counts() -> Result<()> {
    for bits in [1, 2, 16, 255, 65_536] {
        let anscombe = Anscombe::new(bits)?;
        for step in 0..=20 {
            let count = f64::from(bits) * f64::from(step) / 20.0;
            let restored = anscombe.algebraic_inverse(anscombe.transform(count));
            assert!(
                (restored - count).abs() < 1e-9 * f64::from(bits),
                "K = {bits}, {count}"
            );
        }
        assert_eq!(anscombe.algebraic_inverse(-1.0).to_bits(), 0);
        assert!((anscombe.algebraic_inverse(1e6) - f64::from(bits)).abs() < 1e-9);
    }
    Ok(())
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
}
