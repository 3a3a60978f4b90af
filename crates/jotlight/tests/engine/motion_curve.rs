//! The most probable curve of an affine motion.

use jotlight::error::{Error, Result};
use jotlight::motion::{Curve, MODES};
use ndarray::{Array2, Array3};

/// Return a curve of six blocks with estimates up to four times `scale`.
fn curve(scale: f64, ratio: f64) -> Result<Curve> {
    let number = 6;
    let estimates = Array2::from_shape_fn((number, MODES), |(block, mode)| {
        scale * ((block * 7 + mode * 3) % 5) as f64
    });
    let mut information = Array3::zeros((number, MODES, MODES));
    for mut matrix in information.outer_iter_mut() {
        matrix.diag_mut().fill(1.0);
    }
    let ratios = vec![ratio; number - 1];
    Curve::new(estimates.view(), information.view(), &ratios)
}

#[test]
fn the_search_ends_for_estimates_of_any_size() -> Result<()> {
    for scale in [0.0, 1e-160, 1.0, 1e20, 1e100] {
        let smooth = curve(scale, 1.0)?.smooth()?;
        assert!(smooth.iter().all(|value| value.is_finite()), "{scale}");
    }
    for scale in [1e160, 1e300] {
        let smooth = curve(scale, 1.0)?.smooth();
        assert!(matches!(smooth, Err(Error::Range { .. })), "{scale}");
    }
    Ok(())
}

#[test]
fn impossible_weights_and_ratios_are_errors() -> Result<()> {
    for weight in [f64::NAN, f64::INFINITY, 1e3] {
        assert!(curve(1.0, 1.0)?.cost(&[weight; 4]).is_err());
    }
    for ratio in [-1.5, f64::NAN, f64::INFINITY] {
        assert!(matches!(curve(1.0, ratio), Err(Error::Range { .. })));
    }
    Ok(())
}
