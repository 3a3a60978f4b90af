//! K-conditioned parameters: M sets, interpolated by cubic B-splines over log2 K.

use ndarray::{ArrayD, Axis};

use super::LayerParameters;
use crate::error::{Error, Result};
use crate::memory;
use crate::network::spline::evaluate::BASIS;

/// The smallest number M of sets, because four cubic B-splines overlap between two knots.
pub(super) const MIN_SETS: usize = 4;

/// Return the weight of each of M = `sets` parameter sets for K = `trials`.
///
/// The weights are the values of M cubic B-splines at log2 K. Their knots cover the range of K. At
/// most four of them are not 0, and their sum is 1.
///
/// # Errors
/// [`Error::Range`] for a K outside of the range, for fewer than 4 sets, and for a range that is empty
/// or does not lie above 0.
pub fn conditioning_weights(trials: f64, (min, max): (f64, f64), sets: usize) -> Result<Vec<f64>> {
    if sets < MIN_SETS {
        return Err(Error::range("sets", "at least 4 of them", sets));
    }
    if !(min > 0.0 && min < max && max.is_finite()) {
        let expected = "two finite numbers above 0, the smaller one first";
        return Err(Error::range(
            "range of K",
            expected,
            format!("{min} and {max}"),
        ));
    }
    if !(min..=max).contains(&trials) {
        let expected = format!("{min} to {max}, the K that the parameters are for");
        return Err(Error::range("trials", expected, trials));
    }
    let (low, high) = (min.log2(), max.log2());
    let position = (trials.log2() - low) / (high - low) * (sets - 3) as f64;
    let knot = (position.floor().max(0.0) as usize).min(sets - MIN_SETS);
    let t = position - knot as f64;
    memory::check::<f64>("weights", &[sets])?;
    let mut weights = vec![0.0; sets];
    for (weight, basis) in weights[knot..].iter_mut().zip(BASIS) {
        // Multiples of 1/6: their numerators are whole, so that only the last step is rounded there.
        let [a, b, c, d] = basis.map(|coefficient| (6.0 * coefficient).round());
        *weight = (((d * t + c) * t + b) * t + a) / 6.0;
    }
    Ok(weights)
}

/// Return a layer with the weighted sum of its sets of parameters, and the filters divided by
/// `divisor`. With `complement`, its splines are one minus those of the network.
pub(super) fn interpolate_layer(
    parameters: &LayerParameters,
    weights: &[f64],
    divisor: f32,
    complement: bool,
) -> Result<LayerParameters> {
    let mut filters = interpolate("filters", &parameters.filters, 4, weights)?;
    filters /= divisor;
    let coefficients = match &parameters.coefficients {
        // B-splines sum to 1, and so do the weights of the sets. So this is one minus the spline,
        // and near P(b = 1) = 1, no digit is lost.
        Some(coefficients) if complement => {
            let complement = coefficients.mapv(|w| 1.0 - w);
            Some(interpolate("coefficients", &complement, 2, weights)?)
        }
        Some(coefficients) => Some(interpolate("coefficients", coefficients, 2, weights)?),
        None => None,
    };
    Ok(LayerParameters {
        filters,
        coefficients,
        ..*parameters
    })
}

/// Return an array of parameters, or the weighted sum of its sets if it has one more axis.
fn interpolate(
    what: &'static str,
    array: &ArrayD<f32>,
    dimensions: usize,
    weights: &[f64],
) -> Result<ArrayD<f32>> {
    if array.ndim() == dimensions {
        return Ok(array.clone());
    }
    if array.ndim() != dimensions + 1 || array.len_of(Axis(0)) != weights.len() {
        let expected = format_args!(
            "{dimensions} dimensions, or one more for {} sets",
            weights.len()
        );
        return Err(Error::shape(what, expected, array.shape()));
    }
    let mut sum = ArrayD::<f64>::zeros(&array.shape()[1..]);
    let sets = array.axis_iter(Axis(0)).zip(weights);
    for (set, &weight) in sets.filter(|&(_, &weight)| weight != 0.0) {
        sum.zip_mut_with(&set, |sum, &value| *sum += weight * f64::from(value));
    }
    Ok(sum.mapv(|value| value as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_other_dimensions_are_named() {
        let other = interpolate("filters", &ArrayD::zeros(vec![3, 1]), 4, &[0.5; 6]);
        let message = other.map_or_else(|error| error.to_string(), |_| String::new());
        let expected = "filters: expected 4 dimensions, or one more for 6 sets, got [3, 1]";
        assert_eq!(message, expected);
    }

    #[test]
    fn the_weights_are_those_of_cubic_b_splines() -> Result<()> {
        // The values of β3 at its knots are 1/6, 2/3, and 1/6.
        let expected = [0.0, 1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0, 0.0];
        let found = conditioning_weights(16.0, (1.0, 256.0), 5)?;
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12);
        }
        for trials in (2..=512).map(|halves| f64::from(halves) / 2.0) {
            let weights = conditioning_weights(trials, (1.0, 256.0), 6)?;
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(weights.iter().filter(|&&weight| weight > 0.0).count() <= 4);
            // B-splines reproduce straight lines: the centers of the bases, weighted, are log2 K.
            let centers = (0..6).map(|set| 8.0 / 3.0 * (f64::from(set) - 1.0));
            let line: f64 = weights.iter().zip(centers).map(|(w, x)| w * x).sum();
            assert!((line - trials.log2()).abs() < 1e-12);
        }
        for trials in [0.5, 257.0, f64::NAN] {
            assert!(conditioning_weights(trials, (1.0, 256.0), 6).is_err());
        }
        assert!(conditioning_weights(2.0, (1.0, 256.0), 3).is_err());
        for range in [(0.0, 4.0), (2.0, 2.0), (4.0, 1.0), (1.0, f64::INFINITY)] {
            assert!(conditioning_weights(2.0, range, 6).is_err(), "{range:?}");
        }
        Ok(())
    }
}
