//! The expected photons of every jot, row by row, so that no map over the jots is ever held.

use std::ops::Range;

use ndarray::{ArrayView1, ArrayView2, ArrayViewMut2, Axis, s};
use rayon::prelude::*;

use super::{Image, PerJot, Sensor};
use crate::bits::contiguous;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::sensing::kernel::{Kernel, mirrored};

/// Expected detections η s + d per frame, with s = (α/T)·(G c), of the rows of jots from `first` on, into `out` `(rows, W·K̂)`.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn rate(
    sensor: &Sensor<'_>,
    image: Image<'_>,
    first: usize,
    out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    for_each_jot(sensor, image, first, out, |rate, _| rate)
}

/// P(b = 1) of the rows of jots from `first` on, into `out` `(rows, W·K̂)`; 0 where the jot is dead.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
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
            sensor.threshold.fires(rate)
        }
    })
}

fn for_each_jot(
    sensor: &Sensor<'_>,
    image: Image<'_>,
    first: usize,
    mut out: ArrayViewMut2<'_, f32>,
    value: impl Fn(f64, bool) -> f64 + Sync,
) -> Result<()> {
    sensor.check(&image)?;
    let (height, width) = image.shape();
    let side = sensor.kernel.oversampling();
    let (rows, columns) = out.dim();
    if columns != width * side || first + rows > height * side {
        return Err(Error::shape(
            "out",
            format!("rows within {} x {}", height * side, width * side),
            format!("{rows} x {columns} from row {first} on"),
        ));
    }
    let light = Light { sensor, image };
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .for_each_init(Vec::new, |rates, (row, mut out)| {
            let row = first + row;
            light.detections(row, 0..width * side, rates);
            for (column, (out, rate)) in out.iter_mut().zip(rates.iter()).enumerate() {
                *out = value(*rate, sensor.is_dead(row, column)) as f32;
            }
        });
    Ok(())
}

/// The light of an image on a sensor.
pub(super) struct Light<'l, 's, 'i> {
    pub sensor: &'l Sensor<'s>,
    pub image: Image<'i>,
}

impl Light<'_, '_, '_> {
    /// η s + d of the jots of a row and range of columns, into `rates`.
    pub fn detections(&self, row: usize, columns: Range<usize>, rates: &mut Vec<f64>) {
        let kernel = &self.sensor.kernel;
        match self.image {
            Image::F32(image) => filter(kernel, kernel, image, row, columns.clone(), rates),
            Image::F64(image) => filter(kernel, kernel, image, row, columns.clone(), rates),
        }
        let gain = self.sensor.gain_per_frame;
        match self.sensor.efficiency {
            PerJot::Same(efficiency) => stretch(efficiency * gain, 0.0, rates),
            PerJot::Map(map) => {
                let map = map.row(row);
                for (rate, column) in rates.iter_mut().zip(columns.clone()) {
                    *rate *= f64::from(map[column]) * gain;
                }
            }
        }
        match self.sensor.dark_counts {
            PerJot::Same(dark) => stretch(1.0, dark, rates),
            PerJot::Map(map) => {
                let map = map.row(row);
                for (rate, column) in rates.iter_mut().zip(columns) {
                    *rate += f64::from(map[column]);
                }
            }
        }
    }

    /// η s + d of any jot of each of these pixels, where all jots have the same `(η, d)`.
    pub fn block_detections(
        &self,
        row: usize,
        pixels: Range<usize>,
        (efficiency, dark): (f64, f64),
        rates: &mut Vec<f64>,
    ) {
        match self.image {
            Image::F32(image) => widen(image.slice(s![row, pixels]), rates),
            Image::F64(image) => widen(image.slice(s![row, pixels]), rates),
        }
        let share = self.sensor.kernel.taps()[0];
        let sensitivity = efficiency * self.sensor.gain_per_frame * share * share;
        stretch(sensitivity, dark, rates);
    }
}

fn widen<F: Copy + Into<f64>>(values: ArrayView1<'_, F>, out: &mut Vec<f64>) {
    out.clear();
    out.resize(values.len(), 0.0);
    add_scaled(1.0, &contiguous(values), out);
}

levels! {
    /// Adds the light of a row, scaled. In two roundings on every processor, since bits are to be the same on all.
    fn add_scaled[F: Copy + Into<f64>](
        factor: f64, light: &[F], sums: &mut [f64],
    ) = add_scaled_inlined;
    /// rates · factor + term, likewise.
    fn stretch(factor: f64, term: f64, rates: &mut [f64]) = stretch_inlined;
}

#[inline(always)]
fn add_scaled_inlined<F: Copy + Into<f64>>(factor: f64, light: &[F], sums: &mut [f64]) {
    for (sum, &light) in sums.iter_mut().zip(light) {
        *sum += factor * light.into();
    }
}

#[inline(always)]
fn stretch_inlined(factor: f64, term: f64, rates: &mut [f64]) {
    for rate in rates {
        *rate = *rate * factor + term;
    }
}

/// G c: up by K̂, then g along both axes, for the jots of a row and range of columns.
pub(super) fn filter<F: Copy + Into<f64>>(
    down: &Kernel,
    along: &Kernel,
    image: ArrayView2<'_, F>,
    row: usize,
    columns: Range<usize>,
    out: &mut Vec<f64>,
) {
    let side = along.oversampling();
    let (first, phase) = along.last_pixel(columns.start);
    let (last, _) = along.last_pixel(columns.end - 1);
    let light = down_the_columns(down, image, row, first - along.degree() as isize..last + 1);

    // Along the row, the jots at the same place in their pixels at a time, so that the loop over pixels is a plain one.
    let pixels = (last - first + 1) as usize;
    out.clear();
    out.resize(pixels * side, 0.0);
    let mut sums = vec![0.0; pixels];
    for place in 0..side {
        sums.fill(0.0);
        for (back, &tap) in along.taps()[place..].iter().step_by(side).enumerate() {
            add_scaled(tap, &light[along.degree() - back..], &mut sums);
        }
        for (block, &sum) in out.chunks_exact_mut(side).zip(&sums) {
            block[place] = sum;
        }
    }
    out.drain(..phase);
    out.truncate(columns.len());
}

/// The light of the pixels `pixels` on a row of jots, the scene going on mirrored past its rim.
fn down_the_columns<F: Copy + Into<f64>>(
    kernel: &Kernel,
    image: ArrayView2<'_, F>,
    row: usize,
    pixels: Range<isize>,
) -> Vec<f64> {
    let (height, width) = image.dim();
    let mut light: Vec<f64> = vec![0.0; pixels.len()];
    let (bottom, line) = kernel.last_pixel(row);
    let inside = pixels.start.max(0) as usize..(pixels.end.max(0) as usize).min(width);
    let left = (inside.start as isize - pixels.start) as usize;
    let taps = kernel.taps()[line..].iter().step_by(kernel.oversampling());
    for (back, &tap) in taps.enumerate() {
        let row = mirrored(bottom - back as isize, height);
        let seen = contiguous(image.slice_move(s![row, inside.clone()]));
        add_scaled(tap, &seen, &mut light[left..]);
        for pixel in (pixels.start..0).chain(width as isize..pixels.end) {
            light[(pixel - pixels.start) as usize] +=
                tap * image[[row, mirrored(pixel, width)]].into();
        }
    }
    light
}
