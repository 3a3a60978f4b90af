//! Sums over neighboring values of rows, and over neighboring rows.
//!
//! Beyond its borders, an image is reflected, so three neighbors may contain a value m times. In a sum
//! of noise, it has m² times its variance, because it is the same noise. In a sum of variances, it
//! thus counts with a weight of m each time.

use crate::border::mirror_index;

/// The smallest variance by which a squared sum is divided.
const MIN_VARIANCE: f32 = 1e-3;

/// Return how often each of three neighbors from `first` on, which may lie outside, is among them.
pub(super) fn weights_of_variances(first: isize, length: usize) -> [f32; 3] {
    let places = [0, 1, 2].map(|k| mirror_index(first + k, length));
    places.map(|place| places.iter().filter(|&&other| other == place).count() as f32)
}

/// Return the sums with weights other than 1, and these weights, of a row that begins with `margin`
/// reflected values.
pub(super) fn sums_at_borders(margin: usize, width: usize) -> Vec<(usize, [f32; 3])> {
    let weights = |sum: usize| weights_of_variances(sum as isize - margin as isize, width);
    (0..width + 2 * margin - 2)
        .map(|sum| (sum, weights(sum)))
        .filter(|(_, weights)| weights.iter().any(|&weight| weight > 1.0))
        .collect()
}

/// Write the sums of three neighboring variances into `out`.
#[inline(always)]
pub(super) fn add_variances(source: &[f32], at_borders: &[(usize, [f32; 3])], out: &mut [f32]) {
    add_neighbors(source, 1, out);
    for &(sum, weights) in at_borders {
        out[sum] = [0, 1, 2].map(|k| weights[k] * source[sum + k]).iter().sum();
    }
}

/// Write the sum of source\[i\], source\[i + step\], and source\[i + 2·step\] into `out`.
#[inline(always)]
pub(super) fn add_neighbors(source: &[f32], step: usize, out: &mut [f32]) {
    let length = out.len();
    let parts = [0, 1, 2].map(|k| &source[k * step..][..length]);
    for i in 0..length {
        out[i] = parts[0][i] + parts[1][i] + parts[2][i];
    }
}

/// Return the ratio of the square of a sum to its variance.
#[inline(always)]
pub(super) fn squared_ratio(sum: f32, variance: f32) -> f32 {
    let is_large = variance > MIN_VARIANCE;
    sum * sum / if is_large { variance } else { MIN_VARIANCE }
}

/// Write the sum of three rows into `out`.
#[inline(always)]
pub(super) fn add_three(rows: [&[f32]; 3], out: &mut [f32]) {
    let rows = rows.map(|row| &row[..out.len()]);
    for i in 0..out.len() {
        out[i] = rows[0][i] + (rows[1][i] + rows[2][i]);
    }
}

/// Write the weighted sum of three rows into `out`.
#[inline(always)]
pub(super) fn add_weighted(rows: [&[f32]; 3], weights: [f32; 3], out: &mut [f32]) {
    let rows = rows.map(|row| &row[..out.len()]);
    for i in 0..out.len() {
        out[i] = weights[0] * rows[0][i] + (weights[1] * rows[1][i] + weights[2] * rows[2][i]);
    }
}

/// The last `N` rows of an image.
pub(super) struct LastRows<const N: usize> {
    values: Vec<f32>,
    width: usize,
}

impl<const N: usize> LastRows<N> {
    pub fn new(width: usize) -> Self {
        Self {
            values: vec![0.0; N * width],
            width,
        }
    }

    #[inline(always)]
    pub fn row(&self, index: usize) -> &[f32] {
        &self.values[index % N * self.width..][..self.width]
    }

    #[inline(always)]
    pub fn row_mut(&mut self, index: usize) -> &mut [f32] {
        &mut self.values[index % N * self.width..][..self.width]
    }
}
