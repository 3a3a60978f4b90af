//! Levels of K for trials that differ from pixel to pixel, and their weights.

use ndarray::{Array2, ArrayView2};

use super::local_trials::extremes;
use crate::error::{Error, Result};

#[cfg(test)]
mod tests;

/// The maximum ratio of neighboring levels.
const MAX_RATIO: f64 = std::f64::consts::SQRT_2;

/// A level alone serves the trials up to this fraction of the way to the next one, by logarithm.
const PLATEAU: f64 = 0.5;

/// The largest level may have this fraction of the largest number of trials, which costs nothing.
const FEWER: f64 = 0.9;

/// The largest level is lowered if more than this share of the pixels has trials from `FEWER` to `NEAR`
/// times the largest number. Otherwise, these pixels would need two levels.
const MIN_SHARE: f64 = 0.03;

/// See [`MIN_SHARE`].
const NEAR: f64 = 0.99;

/// A level for less than this fraction of the pixels is left out, if the ratio of its neighbors is at
/// most [`MAX_GAP`]. Its pixels get the next lower level. There is none below the lowest level, whose
/// pixels get the next higher one. That one is at most √2 times as large.
const FEW_PIXELS: f64 = 0.002;

/// See [`FEW_PIXELS`].
const MAX_GAP: f64 = 4.0;

fn round(trials: f64) -> u32 {
    trials.round_ties_even().max(1.0) as u32
}

/// Return whole numbers from `smallest` to `largest`, with ratios of at most about √2.
///
/// Those above the smallest depend on the largest one alone. So images of a film have the same
/// levels, and networks keep their parameters.
fn level_range(smallest: f64, largest: f64) -> Vec<u32> {
    let first = round(smallest);
    let mut level = round(largest).max(first);
    let mut levels = vec![level];
    while level > first {
        level = round(f64::from(level) / MAX_RATIO).max(first);
        levels.push(level);
    }
    levels.reverse();
    levels
}

/// Return the levels of a map, without those that few pixels need.
fn levels_of_map(trials: ArrayView2<'_, f32>) -> Vec<u32> {
    let (low, high) = extremes(trials);
    let levels = level_range(f64::from(low), largest_level(trials, f64::from(high)));
    let count = |&level: &u32| trials.iter().filter(|&&n| n >= level as f32).count();
    let above: Vec<_> = levels.iter().map(count).collect();
    let is_rare = |pixels: usize| (pixels as f64) < FEW_PIXELS * trials.len() as f64;
    let below = above.get(1).map(|&higher| trials.len() - higher);
    let first = usize::from(below.is_some_and(is_rare));
    let mut kept = vec![levels[first]];
    for index in first + 1..levels.len() {
        // The last level is always kept.
        let is_needed = above.get(index + 1).is_none_or(|&higher| {
            let pixels = above[index - 1] - higher;
            let gap = f64::from(levels[index + 1]) / f64::from(kept[kept.len() - 1]);
            !is_rare(pixels) || gap > MAX_GAP
        });
        if is_needed {
            kept.push(levels[index]);
        }
    }
    kept
}

/// Return the levels of a map of trials, and their weights at each pixel, of which one is above 0.
///
/// The weights of a pixel belong to the largest level up to its trials, and near the next level to
/// both. Their sum is 1.
///
/// # Errors
/// [`Error::Range`] for a map without pixels, and for trials that are not finite and above 0.
pub fn level_weights(trials: ArrayView2<'_, f32>) -> Result<Vec<(u32, Array2<f32>)>> {
    check_map(trials)?;
    let levels = levels_of_map(trials);
    if let [level] = levels[..] {
        return Ok(vec![(level, Array2::ones(trials.dim()))]);
    }
    let logarithms = levels.iter().map(|&level| f64::from(level).log2());
    let logarithms: Vec<f64> = logarithms.collect();
    let last = levels.len() - 1;
    let place = |trials: f32| {
        // Most pixels have the largest level, and need no logarithm.
        if trials >= levels[last] as f32 {
            return last as f32;
        }
        let logarithm = f64::from(trials.log2());
        let next = logarithms.partition_point(|&level| level <= logarithm);
        if next == 0 || next > last {
            return next.saturating_sub(1) as f32;
        }
        let (below, above) = (logarithms[next - 1], logarithms[next]);
        let start = below + PLATEAU * (above - below);
        let fraction = ((logarithm - start) / (above - start)).max(0.0);
        ((next - 1) as f64 + fraction) as f32
    };
    let places = trials.mapv(place);
    let weights = levels.iter().enumerate().map(|(index, &level)| {
        let weight = |place: f32| (1.0 - (place - index as f32).abs()).max(0.0);
        (level, places.mapv(weight))
    });
    Ok(weights
        .filter(|(_, weights)| weights.iter().any(|&weight| weight > 0.0))
        .collect())
}

/// Check that a map has pixels, and that all trials are finite and above 0.
pub(super) fn check_map(trials: ArrayView2<'_, f32>) -> Result<()> {
    if trials.is_empty() {
        return Err(Error::range("trials", "at least one pixel", "none"));
    }
    let is_wrong = |&&trials: &&f32| !(trials > 0.0 && trials.is_finite());
    match trials.iter().find(is_wrong) {
        Some(wrong) => Err(Error::range("trials", "finite numbers above 0", wrong)),
        None => Ok(()),
    }
}

/// Return the number of trials of the largest level of a map.
///
/// Most pixels of merged bits have about the same number of trials, but a few bits of some of them
/// were left out. The largest level then serves all of these.
fn largest_level(trials: ArrayView2<'_, f32>, largest: f64) -> f64 {
    let above = |share: f64| {
        let limit = (share * largest) as f32;
        trials.iter().filter(|&&n| n >= limit).count()
    };
    let (near, fewer) = (above(NEAR), above(FEWER));
    let is_useful =
        2 * fewer > trials.len() && (fewer - near) as f64 > MIN_SHARE * trials.len() as f64;
    if is_useful { FEWER * largest } else { largest }
}
