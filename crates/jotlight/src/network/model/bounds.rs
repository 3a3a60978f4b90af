//! Bounds of all values in a network, for any data. They show that no value overflows.

use ndarray::Axis;

use super::LayerParameters;
use crate::error::{Error, Result};

/// The largest absolute value that a layer may have.
///
/// Intermediate values can be larger: 36,100 times in the Winograd transforms of convolutions, and
/// 6 times in the polynomials of splines. They are far below the largest `f32`, 3.4e38, in any order
/// of summation.
const MAX_VALUE: f64 = 1e30;

/// The smallest and the largest value that the outputs of a layer may have.
pub(super) type Interval = (f64, f64);

/// Return bounds of the output of each layer, for all data.
///
/// A filter multiplies the largest absolute value of its input by at most the sum of its absolute
/// taps. The values of a spline lie between its smallest and its largest coefficient. The parameters
/// of a K-conditioned layer are weighted means of its sets of parameters, so the extreme values of
/// all sets bound them.
///
/// `max_input` is the largest absolute value that the first layer reads.
///
/// # Errors
/// [`Error::Range`] when the values of a layer may exceed the limit, and when a layer reads or adds
/// a later one.
pub(super) fn output_bounds(layers: &[LayerParameters], max_input: f64) -> Result<Vec<Interval>> {
    let mut bounds: Vec<Interval> = Vec::new();
    for (index, layer) in layers.iter().enumerate() {
        let largest_of = |layer: usize| {
            let Some((low, high)) = bounds.get(layer) else {
                let expected = "the index of an earlier layer";
                return Err(Error::range("input or skip of a layer", expected, layer));
            };
            Ok(low.abs().max(high.abs()))
        };
        let input = match index {
            0 => max_input,
            _ => largest_of(layer.wiring.input.unwrap_or(index - 1))?,
        };
        let skip = layer.wiring.skip.map_or(Ok(0.0), largest_of)?;
        let sum = largest_sum(layer) * input + skip;
        let interval = match &layer.coefficients {
            Some(coefficients) => {
                let extremes = (f64::INFINITY, f64::NEG_INFINITY);
                coefficients.iter().fold(extremes, |(low, high), &value| {
                    (low.min(f64::from(value)), high.max(f64::from(value)))
                })
            }
            None => (-sum, sum),
        };
        let largest = sum.max(interval.0.abs()).max(interval.1.abs());
        if largest > MAX_VALUE {
            let expected = format!(
                "taps and coefficients that keep the values of layer {index} within {MAX_VALUE:e}"
            );
            let received = format!("values of up to {largest:.2e}; train the network again");
            return Err(Error::range("layers", expected, received));
        }
        bounds.push(interval);
    }
    Ok(bounds)
}

/// Return the largest sum of the absolute taps of a filter.
fn largest_sum(layer: &LayerParameters) -> f64 {
    let filters = layer.filters.view();
    let Some(taps) = filters.ndim().checked_sub(3) else {
        return 0.0;
    };
    // The last three axes are the inputs, rows, and columns of a filter.
    let filters = filters.to_shape((
        filters.shape()[..taps].iter().product::<usize>(),
        filters.shape()[taps..].iter().product::<usize>(),
    ));
    let Ok(filters) = filters else { return 0.0 };
    let sums = filters.map_axis(Axis(1), |taps| {
        taps.iter().map(|&tap| f64::from(tap).abs()).sum::<f64>()
    });
    sums.fold(0.0, |largest, &sum| largest.max(sum))
}

#[cfg(test)]
mod tests {
    use ndarray::{ArrayD, IxDyn, array};

    use super::*;
    use crate::network::Wiring;

    fn layer(filters: ArrayD<f32>, line: Option<[f32; 4]>) -> LayerParameters {
        LayerParameters {
            filters,
            coefficients: line.map(|line| array![line].into_dyn()),
            start: 0.0,
            spacing: 1.0,
            wiring: Wiring::default(),
        }
    }

    fn one(tap: f32) -> ArrayD<f32> {
        ArrayD::from_elem(IxDyn(&[1, 1, 1, 1]), tap)
    }

    #[test]
    fn the_bound_of_a_filter_is_the_sum_of_its_absolute_taps() -> Result<()> {
        let mut two = ArrayD::from_elem(IxDyn(&[2, 1, 2, 2]), 1.0);
        two.index_axis_mut(Axis(0), 1).fill(-3.0);
        let opposite = array![[[[2.0f32, -2.0]]]].into_dyn();
        let sets = ArrayD::from_elem(IxDyn(&[4, 1, 1, 1, 1]), 7.0);
        for (filters, input, largest) in [(two, 5.0, 60.0), (opposite, 1.0, 4.0), (sets, 1.0, 7.0)]
        {
            let found = output_bounds(&[layer(filters, None)], input)?;
            assert_eq!(found, [(-largest, largest)]);
        }
        Ok(())
    }

    #[test]
    fn bounds_follow_the_inputs_and_the_skips() -> Result<()> {
        let mut layers = [
            layer(one(2.0), None),
            layer(one(1.0), Some([-9.0, 0.0, 1.0, 3.0])),
            layer(one(-1.0), None),
            layer(one(5.0), None),
        ];
        layers[2].wiring.skip = Some(0);
        layers[3].wiring.input = Some(0);
        let expected = [(-20.0, 20.0), (-9.0, 3.0), (-29.0, 29.0), (-100.0, 100.0)];
        assert_eq!(output_bounds(&layers, 10.0)?, expected);
        Ok(())
    }

    #[test]
    fn values_above_the_limit_are_refused() {
        let line = |factor: f32| Some([-factor, 0.0, factor, 2.0 * factor]);
        let mut skip = [
            layer(one(1.0), line(4.5e29)),
            layer(one(1.0), None),
            layer(one(1.0), None),
        ];
        skip[2].wiring.skip = Some(0);
        let four = ArrayD::from_elem(IxDyn(&[1, 1, 2, 2]), 3e29);
        for layers in [
            &[layer(one(2e29), None)][..],
            &[layer(four, line(1.0))],
            &[layer(one(1.0), line(5.5e29))],
            &skip,
        ] {
            let message =
                output_bounds(layers, 10.0).map_or_else(|e| e.to_string(), |_| String::new());
            let place = format!("layer {} within 1e30", layers.len() - 1);
            assert!(message.contains(&place), "{message}");
        }
    }

    #[test]
    fn the_limit_leaves_room_for_the_transforms_of_convolutions() {
        // Six values of the largest size, a factor of 10 in the input and 19 in the output transform.
        assert!(MAX_VALUE * 10.0 * 19.0 * 1e5 < f64::from(f32::MAX));
    }
}
