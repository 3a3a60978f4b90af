//! The light of a row of jots, G c (paper, section 2.1).
//!
//! G upsamples the image by K̂, and filters it with g along both axes.

use std::ops::Range;

use ndarray::{ArrayView2, s};

use super::interleave::interleave;
use super::kernel::Kernel;
use crate::bits::contiguous;
use crate::border::mirror_index;
use crate::cpu::levels;

/// The number of taps of g that a jot sees, which is the degree of the largest B-spline + 1.
const MAX_TAPS: usize = 4;

/// Replace `out` with G c for a range of jots in a row.
pub(super) fn filter_row<F: Copy + Into<f64>>(
    vertical: &Kernel,
    horizontal: &Kernel,
    image: ArrayView2<'_, F>,
    row: usize,
    columns: Range<usize>,
    out: &mut Vec<f64>,
) {
    let mut planes = Vec::new();
    let phase = filter_positions(
        vertical,
        horizontal,
        image,
        row,
        columns.clone(),
        &mut planes,
    );
    let oversampling = horizontal.oversampling();
    let pixels = planes.len() / oversampling;
    out.resize(planes.len(), 0.0);
    interleave(pixels, &planes, oversampling, out);
    out.drain(..phase);
    out.truncate(columns.len());
}

/// Replace `out` with G c for a range of jots in a row, and return the position of the first jot
/// in its pixel.
///
/// `out` holds the K̂ jots at the same position in their pixels together, for all pixels that
/// contain the range.
pub(super) fn filter_positions<F: Copy + Into<f64>>(
    vertical: &Kernel,
    horizontal: &Kernel,
    image: ArrayView2<'_, F>,
    row: usize,
    columns: Range<usize>,
    out: &mut Vec<f64>,
) -> usize {
    let oversampling = horizontal.oversampling();
    let degree = horizontal.degree();
    let (first, phase) = horizontal.last_pixel(columns.start);
    let (last, _) = horizontal.last_pixel(columns.end - 1);
    let light = filter_columns(vertical, image, row, first - degree as isize..last + 1);
    let pixels = (last - first + 1) as usize;
    out.resize(pixels * oversampling, 0.0);
    for (position, out) in out.chunks_exact_mut(pixels).enumerate() {
        // The last tap belongs to the first pixel.
        let mut taps = [0.0; MAX_TAPS];
        for (distance, tap) in horizontal.pixel_taps(position).enumerate() {
            taps[degree - distance] = tap;
        }
        filter(&taps[..=degree], &light, out);
    }
    phase
}

levels! {
    /// Add factor · light to the sums.
    ///
    /// The product and the sum are rounded separately, so that the result is the same on every
    /// processor.
    pub(super) fn add_scaled[F: Copy + Into<f64>](
        factor: f64, light: &[F], sums: &mut [f64],
    ) = add_scaled_inlined;
    /// Replace `out` with Σ tap · light, where the light begins one value later for each tap.
    fn filter(taps: &[f64], light: &[f64], out: &mut [f64]) = filter_inlined;
}

#[inline(always)]
fn add_scaled_inlined<F: Copy + Into<f64>>(factor: f64, light: &[F], sums: &mut [f64]) {
    for (sum, &light) in sums.iter_mut().zip(light) {
        *sum += factor * light.into();
    }
}

#[inline(always)]
fn filter_inlined(taps: &[f64], light: &[f64], out: &mut [f64]) {
    // The compiler vectorizes a loop whose number of taps is fixed.
    match *taps {
        [a] => filter_with([a], light, out),
        [a, b] => filter_with([a, b], light, out),
        [a, b, c] => filter_with([a, b, c], light, out),
        [a, b, c, d] => filter_with([a, b, c, d], light, out),
        _ => out.fill(0.0),
    }
}

#[inline(always)]
fn filter_with<const TAPS: usize>(taps: [f64; TAPS], light: &[f64], out: &mut [f64]) {
    let light: [&[f64]; TAPS] = std::array::from_fn(|tap| &light[tap..tap + out.len()]);
    for (pixel, out) in out.iter_mut().enumerate() {
        let mut sum = 0.0;
        for tap in (0..TAPS).rev() {
            sum += taps[tap] * light[tap][pixel];
        }
        *out = sum;
    }
}

/// Filter the image along its columns, and return the result at a row of jots for the columns
/// `pixels`.
///
/// The image continues symmetrically beyond its border.
fn filter_columns<F: Copy + Into<f64>>(
    kernel: &Kernel,
    image: ArrayView2<'_, F>,
    row: usize,
    pixels: Range<isize>,
) -> Vec<f64> {
    let (height, width) = image.dim();
    let mut light: Vec<f64> = vec![0.0; pixels.len()];
    let (bottom, position) = kernel.last_pixel(row);
    let inside = pixels.start.max(0) as usize..(pixels.end.max(0) as usize).min(width);
    let left = (inside.start as isize - pixels.start) as usize;
    for (distance, tap) in kernel.pixel_taps(position).enumerate() {
        let row = mirror_index(bottom - distance as isize, height);
        let intensities = contiguous(image.slice_move(s![row, inside.clone()]));
        add_scaled(tap, &intensities, &mut light[left..]);
        for pixel in (pixels.start..0).chain(width as isize..pixels.end) {
            light[(pixel - pixels.start) as usize] +=
                tap * image[[row, mirror_index(pixel, width)]].into();
        }
    }
    light
}
