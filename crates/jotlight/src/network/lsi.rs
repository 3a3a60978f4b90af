//! The linear shift-invariant filters.

use ndarray::{Array3, ArrayView2, ArrayView3, ArrayView4, Axis};
use rayon::prelude::*;

use crate::bits::{FIELD, PackedBits, field, mask_row};
use crate::sensing::mirrored;

/// Columns that are summed side by side, in registers.
const TILE: usize = 64;

/// A stack of planes, continued past its rim by mirroring.
pub(super) struct Padded {
    planes: Array3<f32>,
    height: usize,
    width: usize,
}

impl Padded {
    /// Room for filters of `(height, width)` = `taps` on planes of `(channels, height, width)`.
    pub fn new(planes: ArrayView3<'_, f32>, taps: (usize, usize)) -> Self {
        let (channels, height, width) = planes.dim();
        // Convolution at m reads from m − (taps − 1 − centre) to m + centre.
        let (top, left) = (taps.0 - 1 - taps.0 / 2, taps.1 - 1 - taps.1 / 2);
        let columns: Vec<usize> = (0..width + taps.1 - 1)
            .map(|column| mirrored(column as isize - left as isize, width))
            .collect();
        let mut padded = Array3::zeros((channels, height + taps.0 - 1, columns.len()));
        for (plane, mut padded) in planes.outer_iter().zip(padded.outer_iter_mut()) {
            padded
                .axis_iter_mut(Axis(0))
                .into_par_iter()
                .enumerate()
                .for_each(|(row, mut padded)| {
                    let source = plane.row(mirrored(row as isize - top as isize, height));
                    for (out, &column) in padded.iter_mut().zip(&columns) {
                        *out = source[column];
                    }
                });
        }
        Self {
            planes: padded,
            height,
            width,
        }
    }

    /// (h * u): equation (9), summed over the input channels, for one output channel, then `pointwise`, into a plane.
    pub fn convolve(
        &self,
        filter: ArrayView3<'_, f32>,
        pointwise: impl Fn(f32) -> f32 + Sync,
        mut out: ndarray::ArrayViewMut2<'_, f32>,
    ) {
        debug_assert_eq!(out.dim(), (self.height, self.width));
        // Turned around once, so that the loops below run forward in both.
        let turned = filter.slice(ndarray::s![.., ..;-1, ..;-1]).to_owned();
        out.axis_iter_mut(Axis(0))
            .into_par_iter()
            .enumerate()
            .for_each(|(row, mut out)| {
                for start in (0..self.width).step_by(TILE) {
                    let length = TILE.min(self.width - start);
                    let sums = self.tile(&turned, row, start, length);
                    for (out, &sum) in out.iter_mut().skip(start).zip(&sums[..length]) {
                        *out = pointwise(sum);
                    }
                }
            });
    }

    fn tile(&self, turned: &Array3<f32>, row: usize, start: usize, length: usize) -> [f32; TILE] {
        let mut sums = [0.0f32; TILE];
        for (plane, filter) in self.planes.outer_iter().zip(turned.outer_iter()) {
            for (line, taps) in filter.outer_iter().enumerate() {
                let source = plane.index_axis_move(Axis(0), row + line);
                let Some(source) = source.to_slice() else {
                    continue;
                };
                for (offset, &tap) in taps.iter().enumerate() {
                    let source = &source[start + offset..];
                    if length == TILE
                        && let Some((source, _)) = source.split_first_chunk::<TILE>()
                    {
                        for (sum, value) in sums.iter_mut().zip(source) {
                            *sum += tap * value;
                        }
                    } else {
                        for (sum, value) in sums[..length].iter_mut().zip(source) {
                            *sum += tap * value;
                        }
                    }
                }
            }
        }
        sums
    }
}

/// p = Σ h1·b over each pixel's block of all frames: equation (11), one plane per filter. Where jots are dead, the valid ones
/// stand for them: each counts as their mean, for taps of any sign; a pixel without a valid jot becomes NaN.
pub(super) fn block_filter(
    bits: &PackedBits<'_>,
    valid: Option<ArrayView2<'_, u8>>,
    filters: ArrayView4<'_, f32>,
    (height, width): (usize, usize),
) -> Array3<f32> {
    let mut planes = Array3::zeros((filters.dim().0, height, width));
    for (filter, mut plane) in filters.outer_iter().zip(planes.outer_iter_mut()) {
        plane
            .axis_iter_mut(Axis(0))
            .into_par_iter()
            .enumerate()
            .for_each(|(row, mut out)| {
                let mut blocks = vec![Dead::default(); width];
                for (frame, taps) in filter.outer_iter().enumerate() {
                    for (line, taps) in taps.outer_iter().enumerate() {
                        let jots = bits.row(frame, row * filter.dim().1 + line);
                        let valid = valid.map(|valid| mask_row(valid, row * filter.dim().1 + line));
                        for (pixel, (out, dead)) in out.iter_mut().zip(&mut blocks).enumerate() {
                            let start = pixel * taps.len();
                            if let Some(valid) = &valid {
                                let valid = |jot| field(valid, start + jot, 1) == 1;
                                for (jot, &tap) in taps.iter().enumerate() {
                                    if valid(jot) {
                                        let bit = field(&jots, start + jot, 1) as f32;
                                        *out += tap * bit;
                                        dead.ones += bit;
                                        dead.valid += 1.0;
                                    } else {
                                        dead.taps += tap;
                                    }
                                }
                            } else {
                                add_taps(&jots, start, taps, out);
                            }
                        }
                    }
                }
                if valid.is_some() {
                    for (out, dead) in out.iter_mut().zip(blocks) {
                        *out += dead.taps * (dead.ones / dead.valid);
                    }
                }
            });
    }
    planes
}

/// What stands for the dead jots of a block.
#[derive(Clone, Default)]
struct Dead {
    taps: f32,
    ones: f32,
    valid: f32,
}

fn add_taps(jots: &[u8], start: usize, taps: ndarray::ArrayView1<'_, f32>, sum: &mut f32) {
    for first in (0..taps.len()).step_by(FIELD) {
        let length = FIELD.min(taps.len() - first);
        let bits = field(jots, start + first, length);
        for jot in 0..length {
            *sum += taps[first + jot] * (bits >> (length - 1 - jot) & 1) as f32;
        }
    }
}
