//! Spectra of windows of images, and rows of the correlations whose spectra are given.

use std::f64::consts::PI;
use std::sync::Arc;

use ndarray::ArrayView2;
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use crate::bits::contiguous;
use crate::cpu::levels;

/// The number of frequencies in a [`Part`].
pub(super) const LANES: usize = 16;

/// The number of columns that are transposed together. Their values share a line of the cache.
const COLUMNS_AT_ONCE: usize = 8;

/// The real and the imaginary parts of consecutive frequencies of a spectrum.
pub(super) type Part = [[f32; LANES]; 2];

/// Transforms between windows of the same size and their spectra.
///
/// A spectrum has w/2 + 1 columns of h frequencies, one after the other, because the transforms of
/// columns need contiguous values. The last part of a spectrum is filled with zeros. Two rows are
/// transformed together, as real and imaginary parts.
pub(super) struct Transforms {
    /// h and w, the numbers of rows and columns of the transforms. They are even.
    pub size: (usize, usize),
    /// The factors of the rows and of the columns of a window, which fall to 0 at its outline.
    tapers: [Vec<f32>; 2],
    /// The factor of each frequency, and 0 beyond the last one.
    band: Vec<f32>,
    /// How often each frequency occurs in the whole spectrum, of which half is stored: 1 or 2. It is
    /// 0 for the frequency 0, and beyond the last one.
    pub multiplicity: Vec<f32>,
    row: Arc<dyn Fft<f32>>,
    inverse_row: Arc<dyn Fft<f32>>,
    column: Arc<dyn Fft<f32>>,
    inverse_column: Arc<dyn Fft<f32>>,
}

/// The memory for one transform.
pub(super) struct Scratch {
    /// Pairs of rows.
    rows: Vec<Complex<f32>>,
    pub spectrum: Vec<Complex<f32>>,
    transform: Vec<Complex<f32>>,
}

impl Transforms {
    /// Return the transforms of windows of `size`, between filters of two widths in pixels.
    pub fn new(size: (usize, usize), filters: (f64, f64)) -> Self {
        let (height, width) = (fast_length(size.0), fast_length(size.1));
        let columns = width / 2 + 1;
        let length = (height * columns).next_multiple_of(LANES);
        let (mut band, mut multiplicity) = (vec![0.0; length], vec![0.0; length]);
        let gaussian = |length: usize, sigma: f64| -> Vec<f64> {
            let value = |index: usize| {
                let frequency = 2.0 * PI * index.min(length - index) as f64 / length as f64;
                libm::exp(-(frequency * sigma).powi(2) / 2.0)
            };
            (0..length).map(value).collect()
        };
        let both = |sigma| (gaussian(height, sigma), gaussian(width, sigma));
        let (fine, coarse) = (both(filters.0), both(filters.1));
        for index in 0..height * columns {
            let (column, row) = (index / height, index % height);
            let [fine, coarse] =
                [&fine, &coarse].map(|(rows, columns)| rows[row] * columns[column]);
            band[index] = (fine - coarse) as f32;
            let occurs_once = column == 0 || 2 * column == width;
            multiplicity[index] = if occurs_once { 1.0 } else { 2.0 };
        }
        multiplicity[0] = 0.0;
        let mut planner = FftPlanner::new();
        Self {
            size: (height, width),
            tapers: [taper(size.0), taper(size.1)],
            band,
            multiplicity,
            row: planner.plan_fft_forward(width),
            inverse_row: planner.plan_fft_inverse(width),
            column: planner.plan_fft_forward(height),
            inverse_column: planner.plan_fft_inverse(height),
        }
    }

    /// Return the number of [`Part`]s of a spectrum.
    pub fn parts(&self) -> usize {
        self.band.len() / LANES
    }

    pub fn scratch(&self) -> Scratch {
        let (height, width) = self.size;
        let transforms = [
            &self.row,
            &self.inverse_row,
            &self.column,
            &self.inverse_column,
        ];
        let lengths = transforms.map(|transform| transform.get_inplace_scratch_len());
        Scratch {
            rows: vec![Complex::default(); height / 2 * width],
            spectrum: vec![Complex::default(); self.band.len()],
            transform: vec![Complex::default(); lengths.into_iter().fold(0, usize::max)],
        }
    }

    /// Write the spectrum of a window without its mean, times `factor`, into `out`.
    pub fn forward(
        &self,
        window: ArrayView2<'_, i32>,
        factor: f32,
        scratch: &mut Scratch,
        out: &mut [Part],
    ) {
        let (height, width) = self.size;
        let used = window.nrows().next_multiple_of(2);
        let rows = &mut scratch.rows[..used / 2 * width];
        // The separation of pairs doubles the values.
        load(window, 0.5 * factor, &self.tapers, width, rows);
        self.row.process_with_scratch(rows, &mut scratch.transform);
        let spectrum = &mut scratch.spectrum[..height * (width / 2 + 1)];
        for column in spectrum.chunks_exact_mut(height) {
            column[used..].fill(Complex::default());
        }
        separate_rows(rows, width, height, spectrum);
        self.column
            .process_with_scratch(spectrum, &mut scratch.transform);
        let length = spectrum.len();
        scratch.spectrum[length..].fill(Complex::default());
        separate_parts(&scratch.spectrum, &self.band, out);
    }

    /// Compute h·w times some rows of the image of the spectrum in `scratch`, for [`Scratch::row`].
    pub fn invert(&self, rows: &[usize], scratch: &mut Scratch) {
        let (height, width) = self.size;
        let spectrum = &mut scratch.spectrum[..height * (width / 2 + 1)];
        self.inverse_column
            .process_with_scratch(spectrum, &mut scratch.transform);
        let pairs = &mut scratch.rows[..rows.len().div_ceil(2) * width];
        for (pair, out) in rows.chunks(2).zip(pairs.chunks_exact_mut(width)) {
            let (first, second) = (pair[0], pair[pair.len() - 1]);
            for (index, column) in spectrum.chunks_exact(height).enumerate() {
                let (a, b) = (column[first], column[second]);
                out[index] = Complex::new(a.re - b.im, a.im + b.re);
                let mirrored = if index == 0 { 0 } else { width - index };
                out[mirrored] = Complex::new(a.re + b.im, b.re - a.im);
            }
            // These are real up to rounding.
            for index in [0, width / 2] {
                let (a, b) = (
                    spectrum[index * height + first],
                    spectrum[index * height + second],
                );
                out[index] = Complex::new(a.re, b.re);
            }
        }
        self.inverse_row
            .process_with_scratch(pairs, &mut scratch.transform);
    }
}

impl Scratch {
    /// Return a value of the row `index` of those that [`Transforms::invert`] computed.
    #[inline(always)]
    pub fn value(&self, index: usize, width: usize, column: usize) -> f32 {
        let value = self.rows[index / 2 * width + column];
        if index.is_multiple_of(2) {
            value.re
        } else {
            value.im
        }
    }
}

/// Return the smallest even number, at least `length`, without prime factors above 5.
///
/// Transforms of other lengths are slower.
fn fast_length(length: usize) -> usize {
    let mut even = length.max(1).next_multiple_of(2);
    while without_small_factors(even) > 1 {
        even += 2;
    }
    even
}

fn without_small_factors(number: usize) -> usize {
    [2, 3, 5].into_iter().fold(number, |mut rest, factor| {
        while rest.is_multiple_of(factor) {
            rest /= factor;
        }
        rest
    })
}

/// Return the window of Hann, whose first and last values are 0. That of one value is 1.
fn taper(length: usize) -> Vec<f32> {
    let last = length.saturating_sub(1).max(1) as f64;
    let phase = |index: usize| {
        if length == 1 {
            PI
        } else {
            2.0 * PI * index as f64 / last
        }
    };
    (0..length)
        .map(|index| (0.5 - 0.5 * libm::cos(phase(index))) as f32)
        .collect()
}

levels! {
    /// Write the tapered values of pairs of rows, as real and imaginary parts, without their mean.
    fn load(
        window: ArrayView2<'_, i32>,
        factor: f32,
        tapers: &[Vec<f32>; 2],
        width: usize,
        out: &mut [Complex<f32>],
    ) = load_inlined;
    /// Write the spectra of all rows into columns, from twice the spectra of pairs of rows.
    fn separate_rows(
        pairs: &[Complex<f32>], width: usize, height: usize, out: &mut [Complex<f32>],
    ) = separate_rows_inlined;
    /// Write the real and the imaginary parts of the products of a spectrum and a band.
    fn separate_parts(
        spectrum: &[Complex<f32>], band: &[f32], out: &mut [Part],
    ) = separate_parts_inlined;
}

#[inline(always)]
fn load_inlined(
    window: ArrayView2<'_, i32>,
    factor: f32,
    [down, right]: &[Vec<f32>; 2],
    width: usize,
    out: &mut [Complex<f32>],
) {
    let mut sum = 0;
    for row in window.rows() {
        sum += contiguous(row)
            .iter()
            .map(|&count| i64::from(count))
            .sum::<i64>();
    }
    let mean = (sum as f64 / window.len() as f64) as f32;
    for (pair, out) in out.chunks_exact_mut(width).enumerate() {
        let (first, second) = (2 * pair, (2 * pair + 1).min(down.len() - 1));
        let is_alone = first == second;
        let factors = [down[first], if is_alone { 0.0 } else { down[second] }];
        let factors = factors.map(|down| factor * down);
        let (first, second) = (
            contiguous(window.row(first)),
            contiguous(window.row(second)),
        );
        let (out, padding) = out.split_at_mut(right.len());
        for (((out, &first), &second), &right) in
            out.iter_mut().zip(&*first).zip(&*second).zip(right)
        {
            let (first, second) = (first as f32 - mean, second as f32 - mean);
            *out = Complex::new(first * (factors[0] * right), second * (factors[1] * right));
        }
        padding.fill(Complex::default());
    }
}

#[inline(always)]
fn separate_rows_inlined(
    pairs: &[Complex<f32>],
    width: usize,
    height: usize,
    out: &mut [Complex<f32>],
) {
    let columns = width / 2 + 1;
    for first in (0..columns).step_by(COLUMNS_AT_ONCE) {
        let last = (first + COLUMNS_AT_ONCE).min(columns);
        for (pair, values) in pairs.chunks_exact(width).enumerate() {
            for column in first..last {
                let mirrored = if column == 0 { 0 } else { width - column };
                let (a, b) = (values[column], values[mirrored]);
                let out = &mut out[column * height + 2 * pair..][..2];
                out[0] = Complex::new(a.re + b.re, a.im - b.im);
                out[1] = Complex::new(a.im + b.im, b.re - a.re);
            }
        }
    }
}

#[inline(always)]
fn separate_parts_inlined(spectrum: &[Complex<f32>], band: &[f32], out: &mut [Part]) {
    // With parts of a known length, the compiler gathers and scatters the values of several parts.
    // Otherwise, it shuffles those of one part in registers.
    let parts = spectrum.chunks(LANES).zip(band.chunks(LANES));
    for ([real, imaginary], (spectrum, band)) in out.iter_mut().zip(parts) {
        let length = spectrum.len().min(band.len()).min(LANES);
        let (spectrum, band) = (&spectrum[..length], &band[..length]);
        for lane in 0..length {
            real[lane] = spectrum[lane].re * band[lane];
            imaginary[lane] = spectrum[lane].im * band[lane];
        }
    }
}
