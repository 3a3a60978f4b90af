//! The rate η s + d and the detection probability P(q, η s + d) of each jot (paper, section 2.1).

use std::ops::Range;

use ndarray::{ArrayView1, ArrayView2, ArrayViewMut2, Axis, s};
use rayon::prelude::*;

use super::{Image, PerJot, Sensor};
use crate::bits::contiguous;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;
use crate::sensing::kernel::{Kernel, mirror_index};

/// The number of jots after which a long row asks whether the call is interrupted.
const COLUMNS_PER_QUESTION: usize = 1 << 12;

/// Write the rates η s + d of rows of jots into `out` `(rows, W·K̂)`, with s = (α/T)·(G c).
///
/// The rate is the expected number of detections per frame. The first row of `out` is the row
/// `first` of jots.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if `out` does not
/// hold rows of jots of the image.
pub fn rate(
    sensor: &Sensor<'_>,
    image: Image<'_>,
    first: usize,
    out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    for_each_jot(sensor, image, first, out, |rate, _| rate)
}

/// Write P(b = 1) of rows of jots into `out` `(rows, W·K̂)`. A dead jot has probability 0.
///
/// The first row of `out` is the row `first` of jots.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if `out` does not
/// hold rows of jots of the image.
pub fn probability(
    sensor: &Sensor<'_>,
    image: Image<'_>,
    first: usize,
    out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    for_each_jot(sensor, image, first, out, |rate, dead| {
        if dead {
            0.0
        } else {
            sensor.threshold.detection_probability(rate)
        }
    })
}

/// Write `value` of the rate of each jot, and of whether it is dead, into `out`.
fn for_each_jot(
    sensor: &Sensor<'_>,
    image: Image<'_>,
    first: usize,
    mut out: ArrayViewMut2<'_, f32>,
    value: impl Fn(f64, bool) -> f64 + Sync,
) -> Result<()> {
    sensor.check(&image)?;
    let (jot_rows, jot_columns) = sensor.jots(&image)?;
    let (rows, columns) = out.dim();
    let last = first.checked_add(rows);
    if columns != jot_columns || last.is_none_or(|last| last > jot_rows) {
        return Err(Error::range(
            "out",
            format!("rows within {jot_rows} x {jot_columns} jots"),
            format!("{rows} x {columns} jots from row {first}"),
        ));
    }
    let exposure = Exposure { sensor, image };
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .for_each_init(Vec::new, |rates, (row, mut out)| {
            if interrupt::is_requested() {
                return;
            }
            let row = first + row;
            exposure.jot_rates(row, 0..jot_columns, rates);
            for (column, (out, rate)) in out.iter_mut().zip(rates.iter()).enumerate() {
                if column % COLUMNS_PER_QUESTION == 0 && interrupt::is_requested() {
                    return;
                }
                *out = value(*rate, sensor.is_dead(row, column)) as f32;
            }
        });
    Ok(())
}

/// A sensor, and the image that it records.
pub(crate) struct Exposure<'l, 's, 'i> {
    pub sensor: &'l Sensor<'s>,
    pub image: Image<'i>,
}

impl Exposure<'_, '_, '_> {
    /// Replace `rates` with η s + d of a range of jots in a row.
    pub fn jot_rates(&self, row: usize, columns: Range<usize>, rates: &mut Vec<f64>) {
        let kernel = &self.sensor.kernel;
        match self.image {
            Image::F32(image) => filter_row(kernel, kernel, image, row, columns.clone(), rates),
            Image::F64(image) => filter_row(kernel, kernel, image, row, columns.clone(), rates),
        }
        let gain = self.sensor.gain_per_frame;
        match self.sensor.efficiency {
            PerJot::Same(efficiency) => scale_and_add(efficiency * gain, 0.0, rates),
            PerJot::Map(map) => {
                let map = map.row(row);
                for (rate, column) in rates.iter_mut().zip(columns.clone()) {
                    *rate *= f64::from(map[column]) * gain;
                }
            }
        }
        match self.sensor.dark_counts {
            PerJot::Same(dark_counts) => scale_and_add(1.0, dark_counts, rates),
            PerJot::Map(map) => {
                let map = map.row(row);
                for (rate, column) in rates.iter_mut().zip(columns) {
                    *rate += f64::from(map[column]);
                }
            }
        }
    }

    /// Replace `rates` with η s + d of a range of pixels in a row.
    ///
    /// The sensor must have a uniform response: all jots share `(η, d)`, and all jots of a pixel
    /// have the same rate.
    pub fn pixel_rates(
        &self,
        row: usize,
        pixels: Range<usize>,
        (efficiency, dark_counts): (f64, f64),
        rates: &mut Vec<f64>,
    ) {
        match self.image {
            Image::F32(image) => convert_to_f64(image.slice(s![row, pixels]), rates),
            Image::F64(image) => convert_to_f64(image.slice(s![row, pixels]), rates),
        }
        let tap = self.sensor.kernel.taps()[0];
        let detections_per_intensity = efficiency * self.sensor.gain_per_frame * tap * tap;
        scale_and_add(detections_per_intensity, dark_counts, rates);
    }
}

fn convert_to_f64<F: Copy + Into<f64>>(values: ArrayView1<'_, F>, out: &mut Vec<f64>) {
    out.clear();
    out.resize(values.len(), 0.0);
    add_scaled(1.0, &contiguous(values), out);
}

levels! {
    /// Add factor · light to the sums.
    ///
    /// The product and the sum are rounded separately, so that the result is the same on every
    /// processor.
    fn add_scaled[F: Copy + Into<f64>](
        factor: f64, light: &[F], sums: &mut [f64],
    ) = add_scaled_inlined;
    /// Replace the rates with rates · factor + term. Product and sum are rounded separately too.
    fn scale_and_add(factor: f64, term: f64, rates: &mut [f64]) = scale_and_add_inlined;
}

#[inline(always)]
fn add_scaled_inlined<F: Copy + Into<f64>>(factor: f64, light: &[F], sums: &mut [f64]) {
    for (sum, &light) in sums.iter_mut().zip(light) {
        *sum += factor * light.into();
    }
}

#[inline(always)]
fn scale_and_add_inlined(factor: f64, term: f64, rates: &mut [f64]) {
    for rate in rates {
        *rate = *rate * factor + term;
    }
}

/// Replace `out` with G c for a range of jots in a row.
///
/// G upsamples the image by K̂, and filters it with g along both axes.
pub(super) fn filter_row<F: Copy + Into<f64>>(
    vertical: &Kernel,
    horizontal: &Kernel,
    image: ArrayView2<'_, F>,
    row: usize,
    columns: Range<usize>,
    out: &mut Vec<f64>,
) {
    let oversampling = horizontal.oversampling();
    let degree = horizontal.degree();
    let (first, phase) = horizontal.last_pixel(columns.start);
    let (last, _) = horizontal.last_pixel(columns.end - 1);
    let light = filter_columns(vertical, image, row, first - degree as isize..last + 1);

    // Jots at the same position in their pixels are computed together, so that the inner loop runs
    // over consecutive pixels.
    let pixels = (last - first + 1) as usize;
    out.clear();
    out.resize(pixels * oversampling, 0.0);
    let mut sums = vec![0.0; pixels];
    for position in 0..oversampling {
        sums.fill(0.0);
        for (distance, tap) in horizontal.pixel_taps(position).enumerate() {
            add_scaled(tap, &light[degree - distance..], &mut sums);
        }
        for (block, &sum) in out.chunks_exact_mut(oversampling).zip(&sums) {
            block[position] = sum;
        }
    }
    out.drain(..phase);
    out.truncate(columns.len());
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
