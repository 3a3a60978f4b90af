//! The rates η s + d of a row of jots (paper, section 2.1).

use std::ops::Range;

use ndarray::s;
use num_integer::div_rem;

use super::filter::{add_scaled, filter_positions, filter_row};
use super::{Image, PerJot, Sensor};
use crate::bits::contiguous;
use crate::cpu::levels;

/// A sensor, and the image that it records.
pub(crate) struct Exposure<'l, 's, 'i> {
    pub sensor: &'l Sensor<'s>,
    pub image: Image<'i>,
}

/// The rates η s + d of consecutive jots of a row.
///
/// Jots at the same position in their pixels lie together, so that loops run over consecutive
/// pixels.
#[derive(Debug, Default)]
pub(super) struct RowRates {
    /// The rates, position by position. If there are only those of one position, they serve the
    /// whole pixel.
    pub values: Vec<f64>,
    /// The number of pixels.
    pub pixels: usize,
    /// The number of jots of a pixel.
    pub period: usize,
    /// The position of the first jot in its pixel.
    pub phase: usize,
}

impl RowRates {
    /// Return the index of the rate of a jot.
    pub fn index(&self, jot: usize) -> usize {
        let (pixel, position) = div_rem((jot + self.phase) as u32, self.period as u32);
        let index = pixel as usize;
        if self.values.len() == self.pixels {
            index
        } else {
            index + position as usize * self.pixels
        }
    }
}

impl Exposure<'_, '_, '_> {
    /// Compute the rates of a range of jots in a row. Dead jots have the rate 0.
    pub(super) fn row_rates(&self, row: usize, columns: Range<usize>, out: &mut RowRates) {
        let Sensor {
            kernel,
            efficiency,
            dark_counts,
            dead,
            ..
        } = self.sensor;
        let oversampling = kernel.oversampling();
        let maps = (efficiency, dark_counts, dead);
        let (&PerJot::Same(efficiency), &PerJot::Same(dark_counts), None) = maps else {
            self.jot_rates(row, columns.clone(), &mut out.values);
            if dead.is_some() {
                for (column, rate) in columns.zip(&mut out.values) {
                    if self.sensor.is_dead(row, column) {
                        *rate = 0.0;
                    }
                }
            }
            (out.pixels, out.period, out.phase) = (out.values.len(), 1, 0);
            return;
        };
        out.period = oversampling;
        let detections_per_light = efficiency * self.sensor.gain_per_frame;
        let rates = &mut out.values;
        if kernel.degree() == 0 {
            let pixels = columns.start / oversampling..columns.end.div_ceil(oversampling);
            out.pixels = pixels.len();
            out.phase = columns.start % oversampling;
            rates.resize(out.pixels, 0.0);
            let factor = detections_per_light * kernel.taps()[0] * kernel.taps()[0];
            let place = s![row / oversampling, pixels];
            match self.image {
                Image::F32(image) => {
                    convert(factor, dark_counts, &contiguous(image.slice(place)), rates);
                }
                Image::F64(image) => {
                    convert(factor, dark_counts, &contiguous(image.slice(place)), rates);
                }
            }
        } else {
            out.phase = match self.image {
                Image::F32(image) => filter_positions(kernel, kernel, image, row, columns, rates),
                Image::F64(image) => filter_positions(kernel, kernel, image, row, columns, rates),
            };
            out.pixels = rates.len() / oversampling;
            scale_and_add(detections_per_light, dark_counts, rates);
        }
    }

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
                let map = contiguous(map.slice_move(s![row, columns.clone()]));
                multiply(gain, &map, rates);
            }
        }
        match self.sensor.dark_counts {
            PerJot::Same(dark_counts) => scale_and_add(1.0, dark_counts, rates),
            PerJot::Map(map) => {
                let map = contiguous(map.slice_move(s![row, columns]));
                add_scaled(1.0, &map, rates);
            }
        }
    }
}

levels! {
    /// Replace the rates with rates · factor + term. The product and the sum are rounded
    /// separately, so that the result is the same on every processor.
    fn scale_and_add(factor: f64, term: f64, rates: &mut [f64]) = scale_and_add_inlined;
    /// Replace `out` with image · factor + term, with the same rounding.
    pub(super) fn convert[F: Copy + Into<f64>](
        factor: f64, term: f64, image: &[F], out: &mut [f64],
    ) = convert_inlined;
    /// Multiply the rates by a factor and by a value of a map.
    fn multiply(factor: f64, map: &[f32], rates: &mut [f64]) = multiply_inlined;
}

#[inline(always)]
fn scale_and_add_inlined(factor: f64, term: f64, rates: &mut [f64]) {
    for rate in rates {
        *rate = *rate * factor + term;
    }
}

#[inline(always)]
fn convert_inlined<F: Copy + Into<f64>>(factor: f64, term: f64, image: &[F], out: &mut [f64]) {
    for (rate, &intensity) in out.iter_mut().zip(image) {
        *rate = intensity.into() * factor + term;
    }
}

#[inline(always)]
fn multiply_inlined(factor: f64, map: &[f32], rates: &mut [f64]) {
    for (rate, &value) in rates.iter_mut().zip(map) {
        *rate *= f64::from(value) * factor;
    }
}
