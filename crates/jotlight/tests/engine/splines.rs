//! Comparison of the gradients of splines with central differences.

use jotlight::error::Result;
use jotlight::network::Splines;
use ndarray::{Array2, Array3};

use crate::random::Random;

const START: f64 = -5.0;
const COEFFICIENTS: usize = 9;
const SPACING: f64 = 10.0 / (COEFFICIENTS - 3) as f64;

#[test]
fn gradients_of_splines_agree_with_central_differences() -> Result<()> {
    let mut random = Random(7);
    let planes = Array3::from_shape_simple_fn((2, 3, 20), || 9.0 * (random.fraction() - 0.5));
    let output_gradient = Array3::from_shape_simple_fn((2, 3, 20), || random.fraction() - 0.5);
    let coefficients = Array2::from_shape_simple_fn((3, COEFFICIENTS), || random.fraction() - 0.5);
    let cost = |planes: &Array3<f64>, coefficients: &Array2<f64>| -> Result<f64> {
        let splines = Splines::new(coefficients.view(), START, SPACING)?;
        Ok((splines.activate(planes.view())? * &output_gradient).sum())
    };
    let splines = Splines::new(coefficients.view(), START, SPACING)?;
    let (plane_gradient, coefficient_gradient) =
        splines.pull_back(planes.view(), output_gradient.view())?;
    let step = 1e-5;
    for (index, found) in plane_gradient.indexed_iter() {
        let (mut above, mut below) = (planes.clone(), planes.clone());
        above[index] += step;
        below[index] -= step;
        let difference = cost(&above, &coefficients)? - cost(&below, &coefficients)?;
        assert!((found - difference / (2.0 * step)).abs() < 1e-7);
    }
    for (index, found) in coefficient_gradient.indexed_iter() {
        let (mut above, mut below) = (coefficients.clone(), coefficients.clone());
        above[index] += step;
        below[index] -= step;
        let difference = cost(&planes, &above)? - cost(&planes, &below)?;
        assert!((found - difference / (2.0 * step)).abs() < 1e-7);
    }
    Ok(())
}
