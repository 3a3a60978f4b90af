//! K-conditioned parameters: M sets, interpolated by cubic B-splines over log2 K.

use ndarray::{Array2, ArrayD, ArrayView, Axis, Dimension, Ix2, Ix4};

use super::LayerParameters;
use crate::error::{Error, Result};
use crate::network::layer::Layer;
use crate::network::spline::channels::build_splines;

/// The smallest number M of sets, because four cubic B-splines overlap between two knots.
pub(super) const MIN_SETS: usize = 4;

/// Return the weight of each of M = `sets` parameter sets for K = `trials`.
///
/// The weights are the values of M cubic B-splines at log2 K. Their knots cover the range of K.
///
/// # Errors
/// [`Error::Range`] for a K outside of the range.
pub(super) fn weights(trials: u32, (min, max): (u32, u32), sets: usize) -> Result<Vec<f64>> {
    if !(min..=max).contains(&trials) {
        let expected = format!("{min} to {max}, the K that the parameters are for");
        return Err(Error::range("trials", expected, trials));
    }
    let (low, high) = (f64::from(min).log2(), f64::from(max).log2());
    let spacing = (high - low) / (sets - 3) as f64;
    let splines = build_splines(Array2::eye(sets).view(), low, spacing)?;
    let position = f64::from(trials).log2();
    Ok(splines
        .iter()
        .map(|spline| spline.value(position))
        .collect())
}

/// Return a layer with the weighted sum of its sets of parameters, and the filters divided by
/// `divisor`. With `complement`, its splines are one minus those of the network.
pub(super) fn layer(
    parameters: &LayerParameters,
    weights: &[f64],
    divisor: f32,
    complement: bool,
) -> Result<Layer<f32>> {
    let filters = interpolate::<Ix4>("filters", &parameters.filters, weights)?;
    let coefficients = match &parameters.coefficients {
        // B-splines sum to 1, and so do the weights of the sets. So this is one minus the spline,
        // and near P(b = 1) = 1, no digit is lost.
        Some(coefficients) if complement => Some(coefficients.mapv(|w| 1.0 - w)),
        other => other.clone(),
    };
    let coefficients = coefficients
        .map(|array| interpolate::<Ix2>("coefficients", &array, weights))
        .transpose()?;
    Layer::new(
        filters / divisor,
        coefficients.as_ref().map(|array| array.view()),
        parameters.start as f32,
        parameters.spacing as f32,
        parameters.wiring,
    )
}

/// Return an array of parameters, or the weighted sum of its sets if it has one more axis.
fn interpolate<D: Dimension>(
    what: &'static str,
    array: &ArrayD<f32>,
    weights: &[f64],
) -> Result<ndarray::Array<f32, D>> {
    let received = array.shape().to_vec();
    let dimensions = D::NDIM.unwrap_or(0);
    let wrong = |_| {
        Error::shape(
            what,
            format!("{dimensions} dimensions, or one more"),
            &received,
        )
    };
    if array.ndim() == dimensions {
        return array.clone().into_dimensionality().map_err(wrong);
    }
    if array.ndim() != dimensions + 1 || array.len_of(Axis(0)) != weights.len() {
        return Err(Error::shape(what, dimensions, received));
    }
    let mut sum = ArrayD::<f64>::zeros(&array.shape()[1..]);
    for (set, &weight) in array.axis_iter(Axis(0)).zip(weights) {
        let set: ArrayView<'_, f32, _> = set;
        sum.zip_mut_with(&set, |sum, &value| *sum += weight * f64::from(value));
    }
    sum.mapv(|value| value as f32)
        .into_dimensionality()
        .map_err(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_are_those_of_cubic_b_splines() -> Result<()> {
        // The values of β3 at its knots are 1/6, 2/3, and 1/6.
        let expected = [0.0, 1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0, 0.0];
        for (found, expected) in weights(16, (1, 256), 5)?.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12);
        }
        for trials in 1..=256 {
            let weights = weights(trials, (1, 256), 6)?;
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(weights.iter().filter(|&&weight| weight > 0.0).count() <= 4);
            // B-splines reproduce straight lines: the centers of the bases, weighted, are log2 K.
            let centers = (0..6).map(|set| 8.0 / 3.0 * (f64::from(set) - 1.0));
            let line: f64 = weights.iter().zip(centers).map(|(w, x)| w * x).sum();
            assert!((line - f64::from(trials).log2()).abs() < 1e-12);
        }
        assert!(weights(257, (1, 256), 6).is_err());
        Ok(())
    }
}
