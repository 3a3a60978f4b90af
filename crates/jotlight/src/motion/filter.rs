//! Filters of images in rows of `f32`.

use std::borrow::Cow;

use ndarray::ArrayView1;

use crate::cpu::{self, Simd, WithSimd};
use crate::error::{Error, Result};
use crate::numbers::{Lanes, MAX_LANES};

/// The number of SIMD registers of sums that are computed together.
const VECTORS: usize = 4;

/// The maximum number of values that are filtered together. Rows are padded to a multiple of it.
pub(super) const LANES: usize = VECTORS * MAX_LANES;

/// The distance beyond which a Gaussian is 0, in standard deviations.
const TRUNCATION: f64 = 3.0;

/// The maximum standard deviation of a Gaussian in pixels.
const MAX_SIGMA: f64 = 100.0;

/// The taps of the derivative, exact for polynomials of degree 6.
///
/// Rounding shifts the scene by up to half a pixel. Differences of direct neighbors underestimate
/// the slopes of fine details by a fifth, and so the effect of this shift.
pub(super) const DERIVATIVE: [f32; 7] = [
    -1.0 / 60.0,
    3.0 / 20.0,
    -3.0 / 4.0,
    0.0,
    3.0 / 4.0,
    -3.0 / 20.0,
    1.0 / 60.0,
];

/// Return the taps of a Gaussian, whose sum is 1.
pub(super) fn gaussian(sigma: f64) -> Result<Vec<f32>> {
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

/// Return the index in an image of a row or column that may lie outside: … 1 0 0 1 2 … n-1 n-1 …
#[inline(always)]
pub(super) fn reflect(index: isize, length: usize) -> usize {
    let index = index.rem_euclid(2 * length as isize) as usize;
    index.min(2 * length - 1 - index)
}

/// Replace the values before and after the `length` values of a row that begin at `margin`: the
/// values at a distance of up to `margin` are reflected.
#[inline(always)]
pub(super) fn reflect_margins(row: &mut [f32], margin: usize, length: usize) {
    for distance in 1..=margin {
        row[margin - distance] = row[margin + reflect(-(distance as isize), length)];
        let after = margin + length + distance - 1;
        row[after] = row[margin + reflect((length + distance - 1) as isize, length)];
    }
}

/// Rows of an image in memory.
pub(super) struct Rows<T> {
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
/// `columns` is a multiple of [`LANES`]. If `step` is the stride of `source`, the filter is
/// vertical.
pub(super) fn filter(
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
/// `source` holds the rows of `out`, and as many before and after as there are taps on a side.
pub(super) fn filter_twice(source: &[f32], taps: &[f32], out: &mut [f32], width: usize) {
    let (radius, columns) = (taps.len() / 2, width.next_multiple_of(LANES));
    let stride = columns + 2 * radius;
    let mut padded = vec![0.0; out.len() / columns * stride];
    let vertical = Rows::new(&mut padded[radius..], stride);
    filter(Rows::new(source, columns), columns, taps, vertical, columns);
    for row in padded.chunks_exact_mut(stride) {
        reflect_margins(row, radius, width);
    }
    let (padded, out) = (Rows::new(&padded[..], stride), Rows::new(out, columns));
    filter(padded, 1, taps, out, columns);
}

/// Return the values of a row. They are copied only if they are not contiguous.
pub(super) fn values<T: Copy>(row: ArrayView1<'_, T>) -> Cow<'_, [T]> {
    match row.to_slice() {
        Some(values) => Cow::Borrowed(values),
        None => Cow::Owned(row.iter().copied().collect()),
    }
}
