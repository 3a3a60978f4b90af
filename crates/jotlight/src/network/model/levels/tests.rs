//! Levels of trials, and their weights.

use ndarray::array;

use super::*;

#[test]
fn levels_have_ratios_of_at_most_the_root_of_two() {
    assert_eq!(level_range(3.0, 30.0), [3, 4, 6, 8, 11, 15, 21, 30]);
    assert_eq!(level_range(4.0, 30.0), [4, 6, 8, 11, 15, 21, 30]);
    assert_eq!(level_range(5.2, 5.4), [5]);
    assert_eq!(level_range(0.2, 0.9), [1]);
    assert_eq!(level_range(199.6, 256.2), [200, 256]);
    for last in 1..2000 {
        let levels = level_range(1.0, f64::from(last));
        assert_eq!((levels[0], levels[levels.len() - 1]), (1, last));
        let pairs = levels.iter().zip(&levels[1..]);
        assert!(pairs.clone().all(|(low, high)| low < high));
        // Rounding to whole numbers adds up to a half at both ends.
        assert!(
            pairs
                .clone()
                .all(|(&low, &high)| { f64::from(high) - 0.5 <= 1.415 * (f64::from(low) + 0.5) })
        );
    }
}

#[test]
fn levels_above_the_smallest_depend_on_the_largest_alone() {
    let all = level_range(1.0, 256.0);
    for smallest in [2.0, 7.4, 100.0, 255.0] {
        let levels = level_range(smallest, 256.0);
        assert_eq!(levels[0], smallest.round() as u32);
        assert!(all.ends_with(&levels[1..]), "{levels:?}");
    }
}

#[test]
fn weights_sum_to_one_and_rise_from_half_the_way_on() -> Result<()> {
    let trials = array![[8.0, 9.0, 10.0, 11.0]];
    let weights = level_weights(trials.view())?;
    let start = (8.0f64 * 11.0).log2() / 2.0;
    let rise = ((10.0f64.log2() - start) / (11.0f64.log2() - start)) as f32;
    assert_eq!(weights[0].0, 8);
    assert_eq!(weights[1].0, 11);
    for (column, expected) in [0.0, 0.0, rise, 1.0].into_iter().enumerate() {
        assert!((weights[1].1[[0, column]] - expected).abs() < 1e-6);
        assert!((weights[0].1[[0, column]] + expected - 1.0).abs() < 1e-6);
    }
    Ok(())
}

#[test]
fn maps_without_levels_are_errors() {
    for trials in [
        Array2::zeros((0, 0)),
        Array2::zeros((3, 0)),
        array![[4.0, f32::NAN]],
        array![[f32::NAN, f32::NAN]],
        array![[4.0, 0.0]],
        array![[4.0, -1.0]],
        array![[f32::INFINITY, 4.0]],
    ] {
        let found = level_weights(trials.view());
        assert!(matches!(found, Err(Error::Range { what: "trials", .. })));
    }
}

/// Return the levels of a map.
fn levels(trials: &Array2<f32>) -> Result<Vec<u32>> {
    let found = level_weights(trials.view())?.into_iter();
    Ok(found.map(|(level, _)| level).collect())
}

#[test]
fn one_level_serves_most_pixels_if_a_few_of_their_bits_are_left_out() -> Result<()> {
    let mut trials = Array2::from_shape_fn((40, 50), |(row, column)| {
        256.0 - ((row * 7 + column * 13) % 16) as f32
    });
    // Without pixels between, the largest level is exact.
    let two = trials.mapv(|n| if n > 250.0 { 256.0 } else { 100.0 });
    assert_eq!(levels(&two)?.last(), Some(&256));
    // From 90 to 99 % of the largest number, one level serves all.
    trials.row_mut(0).fill(100.0);
    assert_eq!(levels(&trials)?, [100, 230]);
    Ok(())
}

/// The lowest pixels then get a level that is at most √2 times as large.
#[test]
fn a_lowest_level_for_few_pixels_is_left_out() -> Result<()> {
    let mut trials = Array2::from_elem((40, 50), 256.0);
    trials.row_mut(0).fill(181.0);
    trials[[0, 0]] = 150.0;
    assert_eq!(levels(&trials)?, [181, 256]);
    for (_, weights) in level_weights(trials.view())? {
        assert!((weights[[0, 0]] - weights[[0, 1]]).abs() < 1e-6);
    }
    trials.row_mut(1).fill(150.0);
    assert_eq!(levels(&trials)?, [150, 181, 256]);
    Ok(())
}
