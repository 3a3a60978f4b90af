//! Scores of the velocities of windows of a scene, from the correlations of blocks of frames.

use ndarray::{Array3, ArrayView3, ArrayViewMut2, Axis, s};
use rayon::prelude::*;
use rustfft::num_complex::Complex;

use super::spectra::{LANES, Part, Scratch, Transforms};
use crate::bits::contiguous;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;
use crate::memory;

/// The number of parts of spectra that one task multiplies. Fewer take less time than the start of
/// another task.
const PARTS_PER_TASK: usize = 16;

/// The magnitude, relative to the largest one, below which frequencies lose their weight.
const FLOOR: f32 = 1e-9;

/// The least positive number by which is divided.
const TINY: f32 = 1e-30;

/// Parts of a scene, all of the same size, in which blocks are correlated.
#[derive(Clone, Copy, Debug)]
pub struct Windows<'a> {
    /// The first row and the first column of each window.
    pub corners: &'a [(usize, usize)],
    /// The numbers of rows and columns of a window.
    pub size: (usize, usize),
    /// The standard deviations of the Gaussians between which details are correlated, in pixels.
    pub filters: (f64, f64),
}

/// Return the scores of displacements per block in each window, `(windows, m, m)`.
///
/// The counts of n blocks are `(n, H, W)`. `line` are the m displacements per block, in rows and in
/// columns. For each lag, all pairs of blocks that are this number of blocks apart are correlated
/// together, and the score of a displacement adds the correlations at the lag times the
/// displacement, in their standard deviations. Windows are continued periodically.
///
/// # Errors
/// [`Error::Range`] if a window is empty or not within the image, a lag is not 1 to n − 1, or the
/// line or the filters are not finite. [`Error::Memory`] if the memory is not available.
pub fn velocity_scores(
    blocks: ArrayView3<'_, i32>,
    windows: Windows<'_>,
    lags: &[usize],
    line: &[f64],
) -> Result<Array3<f32>> {
    check(blocks, windows, lags, line)?;
    let transforms = Transforms::new(windows.size, windows.filters);
    memory::check::<Part>("spectra", &[blocks.dim().0, transforms.parts()])?;
    let shape = (windows.corners.len(), line.len(), line.len());
    let mut scores = memory::zeros("scores", shape)?;
    if line.is_empty() {
        return Ok(scores);
    }
    let rows = blocks.lanes(Axis(2)).into_iter();
    let largest = rows.map(|row| largest_magnitude(&contiguous(row))).max();
    let correlator = Correlator {
        blocks,
        windows,
        lags,
        line,
        transforms,
        // Products of smaller numbers do not overflow.
        factor: 1.0 / largest.unwrap_or(0).max(1) as f32,
    };
    scores
        .axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(windows.corners)
        .for_each(|(scores, &corner)| correlator.add_scores(corner, scores));
    Ok(scores)
}

/// Return the largest magnitude of some counts.
fn largest_magnitude(counts: &[i32]) -> u32 {
    let magnitudes = counts.iter().map(|count| count.unsigned_abs());
    magnitudes.fold(0, u32::max)
}

fn check(
    blocks: ArrayView3<'_, i32>,
    windows: Windows<'_>,
    lags: &[usize],
    line: &[f64],
) -> Result<()> {
    let (number, height, width) = blocks.dim();
    let size = windows.size;
    let fits = |first: usize, size: usize, length: usize| {
        size > 0 && first.checked_add(size).is_some_and(|end| end <= length)
    };
    for &corner in windows.corners {
        if !(fits(corner.0, size.0, height) && fits(corner.1, size.1, width)) {
            let expected = format!("parts of an image of {height} x {width}");
            let received = format!("{} x {} at {corner:?}", size.0, size.1);
            return Err(Error::range("windows", expected, received));
        }
    }
    if let Some(&lag) = lags.iter().find(|&&lag| lag == 0 || lag >= number) {
        let expected = format!("1 to less than {number}, the number of blocks");
        return Err(Error::range("lags", expected, lag));
    }
    let filters = [windows.filters.0, windows.filters.1];
    match line.iter().chain(&filters).find(|value| !value.is_finite()) {
        Some(value) => Err(Error::range("line and filters", "finite numbers", value)),
        None => Ok(()),
    }
}

struct Correlator<'a> {
    blocks: ArrayView3<'a, i32>,
    windows: Windows<'a>,
    lags: &'a [usize],
    line: &'a [f64],
    transforms: Transforms,
    /// The factor of all counts.
    factor: f32,
}

impl Correlator<'_> {
    /// Add the scores of a window to zeros.
    fn add_scores(&self, corner: (usize, usize), mut scores: ArrayViewMut2<'_, f32>) {
        if interrupt::is_requested() || self.lags.is_empty() {
            return;
        }
        let products = self.products(&self.spectra(corner));
        let correlations: Vec<_> = (0..self.lags.len())
            .into_par_iter()
            .map_init(
                || self.transforms.scratch(),
                |scratch, index| self.correlation(&products[index..], self.lags[index], scratch),
            )
            .collect();
        // The order of the sum does not depend on the number of threads.
        for correlation in &correlations {
            for (score, value) in scores.iter_mut().zip(correlation) {
                *score += value;
            }
        }
    }

    /// Return the spectra of all blocks in a window, one after the other.
    fn spectra(&self, (top, left): (usize, usize)) -> Vec<Part> {
        let (parts, (height, width)) = (self.transforms.parts(), self.windows.size);
        let window = s![.., top..top + height, left..left + width];
        let mut spectra = vec![Part::default(); self.blocks.dim().0 * parts];
        spectra
            .par_chunks_exact_mut(parts)
            .zip(self.blocks.slice(window).axis_iter(Axis(0)).into_par_iter())
            .for_each_init(
                || self.transforms.scratch(),
                |scratch, (spectrum, window)| {
                    if !interrupt::is_requested() {
                        self.transforms
                            .forward(window, self.factor, scratch, spectrum);
                    }
                },
            );
        spectra
    }

    /// Return the sums of the products of the pairs with each lag, for each part of the spectra.
    fn products(&self, spectra: &[Part]) -> Vec<Part> {
        let (parts, lags) = (self.transforms.parts(), self.lags);
        let mut products = vec![Part::default(); parts * lags.len()];
        products
            .par_chunks_exact_mut(lags.len())
            .enumerate()
            .with_min_len(PARTS_PER_TASK)
            .for_each_init(Vec::new, |blocks, (index, products)| {
                if interrupt::is_requested() {
                    return;
                }
                // The parts of all blocks, side by side, stay in the fastest cache.
                blocks.clear();
                blocks.extend(spectra[index..].iter().step_by(parts));
                multiply(blocks, lags, products);
            });
        products
    }

    /// Return the correlation at the lag times each displacement, in its standard deviations.
    ///
    /// `products` has the part of the lag first, and then those of the other lags.
    fn correlation(&self, products: &[Part], lag: usize, scratch: &mut Scratch) -> Vec<f32> {
        let (count, (height, width)) = (self.line.len(), self.transforms.size);
        let mut correlation = vec![0.0; count * count];
        if interrupt::is_requested() {
            return correlation;
        }
        let mut energy = 0.0;
        let multiplicity = &self.transforms.multiplicity;
        let step = self.lags.len();
        weight(
            products,
            step,
            multiplicity,
            &mut scratch.spectrum,
            &mut energy,
        );
        let factor = 1.0 / (energy.sqrt() as f32).max(TINY);
        let places = |length| -> Vec<_> {
            let place = |&x: &f64| Place::new(lag as f64 * x, length);
            self.line.iter().map(place).collect()
        };
        let (down, right) = (places(height), places(width));
        // Rows of the correlation between which no place lies are not needed.
        let mut rows: Vec<_> = down
            .iter()
            .flat_map(|place| [place.before, place.after])
            .collect();
        rows.sort_unstable();
        rows.dedup();
        self.transforms.invert(&rows, scratch);
        let mut indices = vec![0; height];
        let mut values = Vec::with_capacity(rows.len() * count);
        for (index, &row) in rows.iter().enumerate() {
            indices[row] = index;
            let value = |column| scratch.value(index, width, column);
            let between =
                |place: &Place| place.interpolate(value(place.before), value(place.after));
            values.extend(right.iter().map(between));
        }
        for (place, out) in down.iter().zip(correlation.chunks_exact_mut(count)) {
            let [before, after] =
                [place.before, place.after].map(|row| &values[indices[row] * count..][..count]);
            for ((out, &before), &after) in out.iter_mut().zip(before).zip(after) {
                *out = factor * place.interpolate(before, after);
            }
        }
        correlation
    }
}

/// A place between two periodic values.
struct Place {
    before: usize,
    after: usize,
    /// The distance from the value before.
    fraction: f32,
}

impl Place {
    fn new(place: f64, length: usize) -> Self {
        let first = place.floor();
        let before = first.rem_euclid(length as f64) as usize % length;
        Self {
            before,
            after: (before + 1) % length,
            fraction: (place - first) as f32,
        }
    }

    fn interpolate(&self, before: f32, after: f32) -> f32 {
        before + self.fraction * (after - before)
    }
}

levels! {
    /// Write the sums of the products of all pairs with each lag.
    fn multiply(blocks: &[Part], lags: &[usize], products: &mut [Part]) = multiply_inlined;
    /// Divide the products of every `step`th part by the roots of their magnitudes, and compute the
    /// energy of the result.
    ///
    /// The root is between correlation, whose peaks are wide, and phase correlation.
    fn weight(
        products: &[Part],
        step: usize,
        multiplicity: &[f32],
        spectrum: &mut [Complex<f32>],
        energy: &mut f64,
    ) = weight_inlined;
}

#[inline(always)]
fn multiply_inlined(blocks: &[Part], lags: &[usize], products: &mut [Part]) {
    for (product, &lag) in products.iter_mut().zip(lags) {
        let mut sum = Part::default();
        for ([a, b], [c, d]) in blocks.iter().zip(&blocks[lag..]) {
            for lane in 0..LANES {
                sum[0][lane] += a[lane] * c[lane] + b[lane] * d[lane];
                sum[1][lane] += a[lane] * d[lane] - b[lane] * c[lane];
            }
        }
        *product = sum;
    }
}

#[inline(always)]
fn weight_inlined(
    products: &[Part],
    step: usize,
    multiplicity: &[f32],
    spectrum: &mut [Complex<f32>],
    energy: &mut f64,
) {
    let mut largest = [0.0f32; LANES];
    for [a, b] in products.iter().step_by(step) {
        for lane in 0..LANES {
            let squared = a[lane] * a[lane] + b[lane] * b[lane];
            largest[lane] = if squared > largest[lane] {
                squared
            } else {
                largest[lane]
            };
        }
    }
    let largest = largest.into_iter().fold(0.0, f32::max).sqrt();
    let floor = FLOOR * largest + TINY;
    let mut energies = [0.0f64; LANES];
    let spectrum = spectrum.as_chunks_mut::<LANES>().0.iter_mut();
    let multiplicity = multiplicity.as_chunks::<LANES>().0;
    let products = products.iter().step_by(step);
    for (([a, b], spectrum), multiplicity) in products.zip(spectrum).zip(multiplicity) {
        let (mut real, mut imaginary) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let squared = a[lane] * a[lane] + b[lane] * b[lane];
            let divisor = squared.sqrt() + floor;
            let factor = 1.0 / divisor.sqrt();
            real[lane] = factor * a[lane];
            imaginary[lane] = factor * b[lane];
            energies[lane] += f64::from(multiplicity[lane] * (factor * squared * factor));
        }
        for lane in 0..LANES {
            spectrum[lane] = Complex::new(real[lane], imaginary[lane]);
        }
    }
    *energy = energies.into_iter().sum();
}
