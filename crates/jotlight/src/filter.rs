//! Separable filters of images of `f32`, and the Gaussian blur.

use ndarray::{ArrayView2, ArrayView3, ArrayViewMut2, ArrayViewMut3, Axis};
use rayon::prelude::*;

use crate::bits::contiguous;
use crate::border::{mirror_index, reflect_margins};
use crate::cpu::{self, Simd, WithSimd};
use crate::error::{Error, Result};
use crate::interrupt;
use crate::lanes::{Lanes, MAX_LANES};

/// The number of SIMD registers of sums that are computed together.
const VECTORS: usize = 4;

/// The maximum number of values that are filtered together. Rows are padded to a multiple of it.
pub(crate) const LANES: usize = VECTORS * MAX_LANES;

/// The number of rows that one task filters.
pub(crate) const ROWS_PER_TASK: usize = 16;

/// The distance beyond which a Gaussian is 0, in standard deviations.
const TRUNCATION: f64 = 3.0;

/// The maximum standard deviation of a Gaussian in pixels.
const MAX_SIGMA: f64 = 100.0;

/// Return the taps of a Gaussian, whose sum is 1.
pub(crate) fn gaussian(sigma: f64) -> Result<Vec<f32>> {
    if !(sigma > 0.0 && sigma <= MAX_SIGMA) {
        let expected = format!("above 0 and at most {MAX_SIGMA}");
        return Err(Error::range("width of the filter", expected, sigma));
    }
    let radius = (TRUNCATION * sigma + 0.5) as i32;
    let tap = |distance| libm::exp(-0.5 * (f64::from(distance) / sigma).powi(2));
    let sum: f64 = (-radius..=radius).map(tap).sum();
    Ok((-radius..=radius)
        .map(|distance| (tap(distance) / sum) as f32)
        .collect())
}

/// Rows of an image in memory.
pub(crate) struct Rows<T> {
    pub values: T,
    /// The distance between the first values of neighboring rows.
    pub stride: usize,
}

impl<T> Rows<T> {
    pub fn new(values: T, stride: usize) -> Self {
        Self { values, stride }
    }
}

/// Filter the first `columns` values of rows. Value i of a row of `out` is the sum over k of
/// taps\[k\] times value i + k·step of this row of `source`.
///
/// `columns` is a multiple of [`LANES`]. If `step` is the distance of the rows, the filter is
/// vertical. The stride of `source` may be a multiple of it.
pub(crate) fn filter(
    source: Rows<&[f32]>,
    step: usize,
    taps: &[f32],
    out: Rows<&mut [f32]>,
    columns: usize,
) {
    cpu::run(Filter {
        source,
        step,
        taps,
        out,
        columns,
    });
}

struct Filter<'a> {
    source: Rows<&'a [f32]>,
    step: usize,
    taps: &'a [f32],
    out: Rows<&'a mut [f32]>,
    columns: usize,
}

impl WithSimd for Filter<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let block = VECTORS * f32::lanes::<S>();
        // A block of columns stays in the fastest cache while all its rows are filtered.
        for first in (0..self.columns).step_by(block) {
            for (row, out) in self.out.values.chunks_mut(self.out.stride).enumerate() {
                let start = row * self.source.stride + first;
                let mut sums = [f32::splat(simd, 0.0); VECTORS];
                for (k, &tap) in self.taps.iter().enumerate() {
                    let tap = f32::splat(simd, tap);
                    let values = &self.source.values[start + k * self.step..][..block];
                    for (sum, value) in sums.iter_mut().zip(f32::vectors::<S>(values)) {
                        *sum = f32::multiply_add(simd, tap, *value, *sum);
                    }
                }
                f32::vectors_mut::<S>(&mut out[first..][..block]).copy_from_slice(&sums);
            }
        }
    }
}

/// Apply a filter in both directions to rows of an image with `width` columns, which are padded to
/// a multiple of [`LANES`] values.
///
/// `source` holds rows, and as many before and after as there are taps on a side. `out` holds every
/// `step`th of the former ones.
pub(crate) fn filter_twice(
    source: &[f32],
    step: usize,
    taps: &[f32],
    out: &mut [f32],
    width: usize,
) {
    let (radius, columns) = (taps.len() / 2, width.next_multiple_of(LANES));
    let stride = columns + 2 * radius;
    let mut padded = vec![0.0; out.len() / columns * stride];
    let vertical = Rows::new(&mut padded[radius..], stride);
    let source = Rows::new(source, step * columns);
    filter(source, columns, taps, vertical, columns);
    for row in padded.chunks_exact_mut(stride) {
        reflect_margins(row, radius, width);
    }
    let (padded, out) = (Rows::new(&padded[..], stride), Rows::new(out, columns));
    filter(padded, 1, taps, out, columns);
}

/// Apply a filter in both directions to some rows of an image, of which `first` is the first. Beyond
/// its borders, the image is reflected.
///
/// The rows of `out` are padded to a multiple of [`LANES`] values.
pub(crate) fn filter_rows(image: ArrayView2<'_, f32>, first: usize, taps: &[f32], out: &mut [f32]) {
    let (height, width) = image.dim();
    let (stride, radius) = (width.next_multiple_of(LANES), taps.len() / 2);
    let mut near = vec![0.0; out.len() + 2 * radius * stride];
    for (index, near) in near.chunks_exact_mut(stride).enumerate() {
        let row = (first + index) as isize - radius as isize;
        near[..width].copy_from_slice(&contiguous(image.row(mirror_index(row, height))));
    }
    filter_twice(&near, 1, taps, out, width);
}

/// Write images `(N, H, W)` into `out` after a Gaussian filter with the standard deviation `sigma`
/// in pixels.
///
/// # Errors
/// [`Error::Shape`] if the shapes do not match. [`Error::Range`] if the standard deviation is not
/// above 0 and at most 100.
pub fn blur(
    images: ArrayView3<'_, f32>,
    sigma: f64,
    mut out: ArrayViewMut3<'_, f32>,
) -> Result<()> {
    if out.dim() != images.dim() {
        return Err(Error::shape("output", images.dim(), out.dim()));
    }
    let taps = gaussian(sigma)?;
    if out.is_empty() {
        return Ok(());
    }
    let stride = images.dim().2.next_multiple_of(LANES);
    let filter_band = |image, first, mut out: ArrayViewMut2<'_, f32>| {
        if interrupt::is_requested() {
            return;
        }
        let mut rows = vec![0.0; out.nrows() * stride];
        filter_rows(image, first, &taps, &mut rows);
        for (mut out, row) in out.rows_mut().into_iter().zip(rows.chunks_exact(stride)) {
            out.iter_mut()
                .zip(row)
                .for_each(|(out, &value)| *out = value);
        }
    };
    let images: Vec<_> = images.outer_iter().zip(out.outer_iter_mut()).collect();
    images.into_par_iter().for_each(|(image, mut out)| {
        let bands = out.axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK);
        let bands: Vec<_> = bands.enumerate().collect();
        bands
            .into_par_iter()
            .for_each(|(band, out)| filter_band(image, band * ROWS_PER_TASK, out));
    });
    Ok(())
}
