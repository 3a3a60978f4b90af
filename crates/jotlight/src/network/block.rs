//! The first layer's filters: p = Σ h1·b over each pixel's block of jots and frames, equation (11).

use ndarray::{Array2, Array3, ArrayView2, ArrayView3, ArrayView4, ArrayViewMut4, Axis};
use rayon::prelude::*;

use super::Real;
use super::codes::block_filter;
use crate::bits::{PackedBits, add_block_counts, bit_field as field, mask_row};
use crate::error::{Error, Result};

/// What a first layer reads.
pub(super) enum Blocks<'a> {
    /// For tied filters: the ones of each pixel, and the most that there can be. All pixels with the same count are treated as
    /// one: the layer is run on a plane of the counts 0 to K.
    Counts(Array2<i32>, usize),
    /// For filters that weigh the jots singly: the bits themselves, and the rows and columns of pixels.
    Jots(PackedBits<'a>, (usize, usize)),
}

impl<'a> Blocks<'a> {
    /// What filters read of the bits of a sensor with K̂ = `side`.
    pub fn of(bits: PackedBits<'a>, side: usize, tied: bool) -> Result<Self> {
        let pixels = bits.pixel_shape(side)?;
        if !tied {
            return Ok(Self::Jots(bits, pixels));
        }
        let mut counts = Array2::zeros(pixels);
        add_block_counts(&bits, side, None, counts.view_mut())?;
        Ok(Self::Counts(counts, bits.shape().0 * side * side))
    }

    /// p, one plane per filter: over the pixels, or over the counts.
    pub fn filtered<F: Real>(&self, filters: ArrayView4<'_, F>) -> Array3<F> {
        match self {
            Self::Counts(_, most) => {
                let weights: Vec<F> = filters.iter().copied().collect();
                Array3::from_shape_fn((weights.len(), 1, most + 1), |(channel, _, count)| {
                    weights[channel] * F::from_index(count)
                })
            }
            Self::Jots(bits, pixels) => block_filter(bits, filters, *pixels),
        }
    }

    /// From planes of the layer to planes over the pixels.
    pub fn spread<F: Real>(&self, planes: Array3<F>) -> Array3<F> {
        match self {
            Self::Counts(counts, _) => {
                let mut out = Array3::zeros((planes.dim().0, counts.nrows(), counts.ncols()));
                for (mut out, table) in out.outer_iter_mut().zip(planes.outer_iter()) {
                    let table = table.row(0);
                    out.zip_mut_with(counts, |value, &count| *value = table[count as usize]);
                }
                out
            }
            Self::Jots(..) => planes,
        }
    }

    /// The adjoint of [`Blocks::spread`].
    pub fn gather<F: Real>(&self, planes: Array3<F>) -> Array3<F> {
        let Self::Counts(counts, most) = self else {
            return planes;
        };
        let mut out = Array3::zeros((planes.dim().0, 1, most + 1));
        for (mut out, plane) in out.outer_iter_mut().zip(planes.outer_iter()) {
            let mut sums = vec![0.0; most + 1];
            for (&value, &count) in plane.iter().zip(counts) {
                sums[count as usize] += value.as_f64();
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = F::from_f64(sum);
            }
        }
        out
    }

    /// Adds the gradient with respect to the taps, given that of p.
    pub fn push_to_taps<F: Real>(
        &self,
        gradient: ArrayView3<'_, F>,
        mut of_taps: ArrayViewMut4<'_, f64>,
    ) {
        for (gradient, mut of_taps) in gradient.outer_iter().zip(of_taps.outer_iter_mut()) {
            self.each_tap(of_taps.dim(), |tap, plane: &[F]| {
                let products = gradient.iter().zip(plane).map(|(&g, &x)| (g * x).as_f64());
                of_taps[tap] += products.sum::<f64>();
            });
        }
    }

    /// Calls `visit` with the place of each tap and what it weighs, row by row.
    pub fn each_tap<F: Real>(
        &self,
        (frames, lines, columns): (usize, usize, usize),
        mut visit: impl FnMut([usize; 3], &[F]),
    ) {
        match self {
            Self::Counts(_, most) => {
                let counts: Vec<F> = (0..=*most).map(F::from_index).collect();
                visit([0, 0, 0], &counts);
            }
            Self::Jots(bits, (height, width)) => {
                let mut plane = vec![F::zero(); height * width];
                for frame in 0..frames {
                    for line in 0..lines {
                        for column in 0..columns {
                            for (row, plane) in plane.chunks_exact_mut(*width).enumerate() {
                                let jots = bits.row(frame, row * lines + line);
                                for (pixel, value) in plane.iter_mut().enumerate() {
                                    let bit = field(&jots, pixel * columns + column, 1);
                                    *value = F::from_index(bit as usize);
                                }
                            }
                            visit([frame, line, column], &plane);
                        }
                    }
                }
            }
        }
    }
}

/// Checks that a first layer's filters `(C, T, K̂, K̂)` fit bits, and tells the pixels' rows and columns.
pub(super) fn check_block<F: Real>(
    filters: ArrayView4<'_, F>,
    bits: &PackedBits<'_>,
) -> Result<(usize, usize)> {
    let (_, frames, height, width) = filters.dim();
    if height != width {
        return Err(Error::shape(
            "filters of a first layer",
            "squares of K̂ x K̂ taps",
            (height, width),
        ));
    }
    if frames != bits.shape().0 {
        return Err(Error::shape("frames of the bits", frames, bits.shape().0));
    }
    bits.pixel_shape(height)
}

/// p of whole filters where some jots are dead: the valid ones stand for them, and each counts as their mean, for taps of any sign;
/// a pixel without a valid jot becomes NaN.
pub(super) fn masked_filter<F: Real>(
    bits: &PackedBits<'_>,
    valid: ArrayView2<'_, u8>,
    filters: ArrayView4<'_, F>,
    (height, width): (usize, usize),
) -> Array3<F> {
    let mut planes = Array3::zeros((filters.dim().0, height, width));
    for (filter, mut plane) in filters.outer_iter().zip(planes.outer_iter_mut()) {
        plane
            .axis_iter_mut(Axis(0))
            .into_par_iter()
            .enumerate()
            .for_each(|(row, mut out)| {
                let mut blocks = vec![Dead::<F>::default(); width];
                for (frame, taps) in filter.outer_iter().enumerate() {
                    for (line, taps) in taps.outer_iter().enumerate() {
                        let jots = bits.row(frame, row * filter.dim().1 + line);
                        let valid = mask_row(valid, row * filter.dim().1 + line);
                        for (pixel, (out, dead)) in out.iter_mut().zip(&mut blocks).enumerate() {
                            for (jot, &tap) in taps.iter().enumerate() {
                                let place = pixel * taps.len() + jot;
                                if field(&valid, place, 1) == 1 {
                                    let bit = F::from_index(field(&jots, place, 1) as usize);
                                    *out += tap * bit;
                                    dead.ones += bit;
                                    dead.valid += F::one();
                                } else {
                                    dead.taps += tap;
                                }
                            }
                        }
                    }
                }
                for (out, dead) in out.iter_mut().zip(blocks) {
                    *out += dead.taps * (dead.ones / dead.valid);
                }
            });
    }
    planes
}

/// What stands for the dead jots of a block.
#[derive(Clone, Default)]
struct Dead<F> {
    taps: F,
    ones: F,
    valid: F,
}
