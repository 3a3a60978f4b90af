//! Numbers of trials that differ from pixel to pixel: their neighborhoods, and levels of K.

use ndarray::{Array1, Array2, ArrayView1, ArrayView2, Axis};

/// The maximum ratio of neighboring levels.
const MAX_RATIO: f64 = std::f64::consts::SQRT_2;

/// A level alone serves the trials up to this fraction of the way to the next one, by logarithm.
const PLATEAU: f64 = 0.5;

/// The standard deviation of the neighborhood in which noise is averaged, in pixels.
const NEIGHBORHOOD: f64 = 3.0;

/// The radius of the neighborhood: three standard deviations.
const RADIUS: usize = 9;

/// The ratio of the largest to the smallest local trials up to which one run serves all pixels.
const NEAR_RATIO: f32 = 1.2;

/// The number of trials that states the noise around each pixel.
pub(super) enum LocalTrials {
    /// The same whole number everywhere.
    Same(u32),
    /// A number for each pixel.
    Map(Array2<f32>),
}

/// Return the harmonic mean of the trials in the neighborhood of each pixel.
pub(super) fn local_trials(trials: ArrayView2<'_, f64>) -> LocalTrials {
    if let Some(same) = super::only_value(trials) {
        return LocalTrials::Same(round(same));
    }
    let noise = blur(&trials.mapv(|trials| 1.0 / trials as f32));
    let (low, high) = noise
        .iter()
        .fold((f32::INFINITY, 0.0f32), |(low, high), &x| {
            (low.min(x), high.max(x))
        });
    if high <= NEAR_RATIO * low {
        let sum: f64 = noise.iter().copied().map(f64::from).sum();
        return LocalTrials::Same(round(noise.len() as f64 / sum));
    }
    LocalTrials::Map(noise.mapv(|noise| 1.0 / noise))
}

fn round(trials: f64) -> u32 {
    trials.round_ties_even().max(1.0) as u32
}

/// Return an image after a Gaussian filter. Beyond the border, the nearest pixel is repeated.
fn blur(image: &Array2<f32>) -> Array2<f32> {
    let taps = (0..=RADIUS).map(|x| (-0.5 * (x as f64 / NEIGHBORHOOD).powi(2)).exp());
    let taps: Array1<f64> = taps.collect();
    let taps = &taps / (2.0 * taps.sum() - taps[0]);
    let mut result = image.clone();
    for axis in [Axis(0), Axis(1)] {
        for mut lane in result.lanes_mut(axis) {
            let blurred = blur_lane(lane.view(), &taps);
            lane.assign(&blurred);
        }
    }
    result
}

fn blur_lane(lane: ArrayView1<'_, f32>, taps: &Array1<f64>) -> Array1<f32> {
    let last = lane.len() - 1;
    Array1::from_shape_fn(lane.len(), |place| {
        let sum = (1..=RADIUS).map(|offset| {
            let neighbors = [place.saturating_sub(offset), (place + offset).min(last)];
            taps[offset]
                * neighbors
                    .map(|index| f64::from(lane[index]))
                    .iter()
                    .sum::<f64>()
        });
        (taps[0] * f64::from(lane[place]) + sum.sum::<f64>()) as f32
    })
}

/// Return whole numbers from `smallest` to `largest`, with ratios of at most about √2.
pub(super) fn level_range(smallest: f64, largest: f64) -> Vec<u32> {
    let (first, last) = (f64::from(round(smallest)), f64::from(round(largest)));
    let steps = ((last / first).log2() / MAX_RATIO.log2() - 1e-9)
        .ceil()
        .max(0.0);
    let ratio = if steps > 0.0 {
        (last / first).powf(1.0 / steps)
    } else {
        1.0
    };
    let mut levels: Vec<_> = (0..=steps as i32)
        .map(|step| round(first * ratio.powi(step)))
        .collect();
    levels.dedup();
    levels
}

/// Return the levels of a map of trials, and their weights at each pixel, of which one is above 0.
///
/// The weights of a pixel belong to the largest level up to its trials, and near the next level to
/// both. Their sum is 1.
pub(super) fn level_weights(trials: ArrayView2<'_, f32>) -> Vec<(u32, Array2<f32>)> {
    let extremes = trials
        .iter()
        .fold((f32::INFINITY, 0.0f32), |(low, high), &x| {
            (low.min(x), high.max(x))
        });
    let levels = level_range(f64::from(extremes.0), f64::from(extremes.1));
    let logarithms: Vec<_> = levels
        .iter()
        .map(|&level| f64::from(level).log2())
        .collect();
    let place = |trials: f32| {
        let logarithm = f64::from(trials.log2());
        let next = logarithms.partition_point(|&level| level <= logarithm);
        if next == 0 || next == logarithms.len() {
            return next.saturating_sub(1) as f64;
        }
        let (below, above) = (logarithms[next - 1], logarithms[next]);
        let start = below + PLATEAU * (above - below);
        let fraction = ((logarithm - start) / (above - start)).max(0.0);
        (next - 1) as f64 + fraction
    };
    let places = trials.mapv(place);
    let weights = levels.iter().enumerate().map(|(index, &level)| {
        let weight = |place: f64| (1.0 - (place - index as f64).abs()).max(0.0) as f32;
        (level, places.mapv(weight))
    });
    weights
        .filter(|(_, weights)| weights.iter().any(|&weight| weight > 0.0))
        .collect()
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn levels_have_ratios_of_at_most_the_root_of_two() {
        assert_eq!(level_range(3.0, 30.0), [3, 4, 6, 8, 11, 16, 22, 30]);
        assert_eq!(level_range(5.2, 5.4), [5]);
        for last in 1..2000 {
            let levels = level_range(1.0, f64::from(last));
            assert_eq!((levels[0], levels[levels.len() - 1]), (1, last));
            let pairs = levels.iter().zip(&levels[1..]);
            assert!(pairs.clone().all(|(low, high)| low < high));
            // Rounding to whole numbers adds up to a half at both ends.
            assert!(
                pairs.clone().all(|(&low, &high)| {
                    f64::from(high) - 0.5 <= 1.415 * (f64::from(low) + 0.5)
                })
            );
        }
    }

    #[test]
    fn weights_sum_to_one_and_rise_from_half_the_way_on() {
        let trials = array![[8.0, 9.0, 10.0, 11.0]];
        let weights = level_weights(trials.view());
        let start = (8.0f64 * 11.0).log2() / 2.0;
        let rise = ((10.0f64.log2() - start) / (11.0f64.log2() - start)) as f32;
        assert_eq!(weights[0].0, 8);
        assert_eq!(weights[1].0, 11);
        for (column, expected) in [0.0, 0.0, rise, 1.0].into_iter().enumerate() {
            assert!((weights[1].1[[0, column]] - expected).abs() < 1e-6);
            assert!((weights[0].1[[0, column]] + expected - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn local_trials_are_harmonic_means() {
        let image = Array2::from_shape_fn((30, 40), |(row, column)| {
            4.0 + f64::from((row * 7 + column * 13) as u32 % 23)
        });
        let LocalTrials::Map(found) = local_trials(image.view()) else {
            let trials = Array2::from_elem((3, 4), 16.4);
            assert!(matches!(local_trials(trials.view()), LocalTrials::Same(16)));
            return;
        };
        let gaussian = |x: i32| (-0.5 * f64::from(x * x) / 9.0).exp();
        for (row, column) in [(0, 0), (15, 20), (29, 3)] {
            let (mut total, mut sum) = (0.0, 0.0);
            for (i, j) in ndarray::indices((19, 19)) {
                let (i, j) = (i as i32 - 9, j as i32 - 9);
                let weight = gaussian(i) * gaussian(j);
                let place = [(row + i).clamp(0, 29), (column + j).clamp(0, 39)];
                total += weight;
                sum += weight / image[place.map(|index| index as usize)];
            }
            let expected = total / sum;
            let found = f64::from(found[[row as usize, column as usize]]);
            assert!((found - expected).abs() < 1e-5 * expected);
        }
    }
}
