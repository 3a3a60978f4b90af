//! The rate η s + d and the detection probability P(q, η s + d) of each jot (paper, section 2.1).

use ndarray::{ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::exposure::Exposure;
use super::{Image, Sensor};
use crate::error::{Error, Result};
use crate::interrupt;

/// The number of jots after which a long row asks whether the call is interrupted.
const COLUMNS_PER_QUESTION: usize = 1 << 12;

/// Write the rates η s + d of rows of jots into `out` `(rows, W·K̂)`, with s = (α/T)·(G c).
///
/// The rate is the expected number of detections per frame. The first row of `out` is the row
/// `first` of jots.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if `out` does not
/// hold rows of jots of the image, or if a parameter of the sensor or an intensity is infinite, NaN,
/// or negative.
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
/// hold rows of jots of the image, or if a parameter of the sensor or an intensity is infinite, NaN,
/// or negative.
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
    sensor.check_values(&image, first..first + rows)?;
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
