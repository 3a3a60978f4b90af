use jotlight::likelihood::Threshold;
use jotlight::mle::{self, JotCounts, PixelResponse};
use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::likelihood::{PyCounts, PyFloats};
use crate::{run, to_python};

/// (threshold, sensitivity, largest intensity), as `Sensor._response` gives them.
type Response = (u32, f64, f64);

fn response((threshold, sensitivity, max_intensity): Response) -> PyResult<PixelResponse> {
    Ok(PixelResponse {
        threshold: Threshold::new(threshold).map_err(to_python)?,
        sensitivity,
        max_intensity,
    })
}

#[pyfunction]
#[pyo3(signature = (sensor, counts, trials, dark, out, threads))]
pub fn mle_from_counts(
    py: Python<'_>,
    sensor: Response,
    counts: PyReadonlyArray1<'_, i32>,
    trials: PyCounts<'_>,
    dark: PyFloats<'_>,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response(sensor)?;
    let (trials, dark) = (trials.view()?, dark.view()?);
    let (counts, out) = (counts.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::from_counts(&response, counts, trials, dark, out)
    })
}

#[pyfunction]
#[pyo3(signature = (sensor, counts, trials, dark, bits, reference, out, threads))]
#[allow(clippy::too_many_arguments)]
pub fn equivalent_counts(
    py: Python<'_>,
    sensor: Response,
    counts: PyReadonlyArray1<'_, i32>,
    trials: PyCounts<'_>,
    dark: PyFloats<'_>,
    bits: i32,
    reference: f64,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response(sensor)?;
    let (trials, dark) = (trials.view()?, dark.view()?);
    let (counts, out) = (counts.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::equivalent_counts(&response, counts, trials, dark, bits, reference, out)
    })
}

#[pyfunction]
#[pyo3(signature = (sensor, probability, dark, out, threads))]
pub fn mle_from_probability(
    py: Python<'_>,
    sensor: Response,
    probability: PyReadonlyArray1<'_, f32>,
    dark: f64,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response(sensor)?;
    let (probability, out) = (probability.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::from_probability(&response, probability, dark, out)
    })
}

#[pyfunction]
#[pyo3(signature = (sensor, ones, dark, dead, frames, side, width, out, threads))]
#[allow(clippy::too_many_arguments)]
pub fn mle_from_jots(
    py: Python<'_>,
    sensor: Response,
    ones: PyReadonlyArray1<'_, i32>,
    dark: PyReadonlyArray1<'_, f32>,
    dead: Option<PyReadonlyArray1<'_, bool>>,
    frames: i32,
    side: usize,
    width: usize,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response(sensor)?;
    let jots = JotCounts {
        ones: ones.as_slice()?,
        dark: dark.as_slice()?,
        dead: match &dead {
            Some(dead) => Some(dead.as_slice()?),
            None => None,
        },
        frames,
        side,
    };
    let out = out.as_slice_mut()?;
    run(py, threads, || mle::from_jots(&response, &jots, width, out))
}
