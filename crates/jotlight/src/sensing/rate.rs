//! The expected photons of every jot, row by row, so that no map over the jots is ever held.

use std::ops::Range;

use ndarray::{ArrayView2, ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::{Image, Sensor};
use crate::error::{Error, Result};
use crate::sensing::kernel::{Kernel, mirrored};

/// Expected detections η s + d of every jot and frame, with s = (α/T)·(G c), into `out` `(H·K̂, W·K̂)`.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn rate(sensor: &Sensor<'_>, image: Image<'_>, out: ArrayViewMut2<'_, f32>) -> Result<()> {
    for_each_jot(sensor, image, out, |rate, _| rate)
}

/// P(b = 1) of every jot, into `out` `(H·K̂, W·K̂)`; 0 where the jot is dead.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn probability(
    sensor: &Sensor<'_>,
    image: Image<'_>,
    out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    for_each_jot(sensor, image, out, |rate, dead| {
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
    mut out: ArrayViewMut2<'_, f32>,
    value: impl Fn(f64, bool) -> f64 + Sync,
) -> Result<()> {
    sensor.check(&image)?;
    let (height, width) = image.shape();
    let side = sensor.kernel.oversampling();
    if out.dim() != (height * side, width * side) {
        return Err(Error::shape(
            "out",
            (height * side, width * side),
            out.dim(),
        ));
    }
    let light = Light { sensor, image };
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .for_each_init(Vec::new, |rates, (row, mut out)| {
            light.photons(row, 0..width * side, rates);
            for (column, (out, photons)) in out.iter_mut().zip(rates.iter()).enumerate() {
                *out = value(
                    light.detections(row, column, *photons),
                    sensor.is_dead(row, column),
                ) as f32;
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
    /// s of the jots of a row and range of columns, into `photons`.
    pub fn photons(&self, row: usize, columns: Range<usize>, photons: &mut Vec<f64>) {
        match self.image {
            Image::F32(image) => filter(&self.sensor.kernel, image, row, columns, photons),
            Image::F64(image) => filter(&self.sensor.kernel, image, row, columns, photons),
        }
        for photons in photons {
            *photons *= self.sensor.gain_per_frame;
        }
    }

    /// s of each jot of a pixel, for the box kernel.
    pub fn block_photons(&self, row: usize, column: usize) -> f64 {
        let intensity = match self.image {
            Image::F32(image) => f64::from(image[[row, column]]),
            Image::F64(image) => image[[row, column]],
        };
        let share = self.sensor.kernel.taps()[0];
        self.sensor.gain_per_frame * share * share * intensity
    }

    /// η s + d.
    pub fn detections(&self, row: usize, column: usize, photons: f64) -> f64 {
        self.sensor.efficiency * photons + self.sensor.dark_counts.at(row, column)
    }
}

/// G c: up by K̂, then g along both axes, for the jots of a row and range of columns.
fn filter<F: Copy + Into<f64>>(
    kernel: &Kernel,
    image: ArrayView2<'_, F>,
    row: usize,
    columns: Range<usize>,
    out: &mut Vec<f64>,
) {
    let (height, width) = image.dim();
    let side = kernel.oversampling();
    let degree = kernel.degree() as isize;
    let (first, phase) = kernel.last_pixel(columns.start);
    let (last, _) = kernel.last_pixel(columns.end - 1);

    // Down the columns of all pixels that these jots see, …
    let (bottom, line) = kernel.last_pixel(row);
    let mut light: Vec<f64> = vec![0.0; (last - first + 1 + degree) as usize];
    for (back, &tap) in kernel.taps()[line..].iter().step_by(side).enumerate() {
        let image = image.row(mirrored(bottom - back as isize, height));
        for (light, pixel) in light.iter_mut().zip(first - degree..) {
            *light += tap * image[mirrored(pixel, width)].into();
        }
    }

    // … then along the row, block by block.
    out.clear();
    out.resize((last - first + 1) as usize * side, 0.0);
    for (block, light) in out
        .chunks_exact_mut(side)
        .zip(light.windows(degree as usize + 1))
    {
        for (taps, light) in kernel.taps().chunks_exact(side).zip(light.iter().rev()) {
            for (sum, tap) in block.iter_mut().zip(taps) {
                *sum += tap * light;
            }
        }
    }
    out.drain(..phase);
    out.truncate(columns.len());
}
