use jotlight::likelihood::Threshold;
use jotlight::mle::{self, Jot, JotCounts, Jots, PixelResponse};
use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::likelihood::{PyCounts, PyFloats};
use crate::{run, to_python};

/// (threshold, light per jot and frame, largest intensity), as `Sensor._response` gives them.
type Response = (u32, f64, f64);

fn response((threshold, light, max_intensity): Response) -> PyResult<PixelResponse> {
    Ok(PixelResponse {
        threshold: Threshold::new(threshold).map_err(to_python)?,
        light,
        max_intensity,
    })
}

/// (efficiency, dark counts) of all jots.
type PyJot = (f64, f64);

fn jot((efficiency, dark): PyJot) -> Jot {
    Jot { efficiency, dark }
}

/// (efficiency, dark counts), each one number or one for each pixel or jot.
#[derive(FromPyObject)]
pub struct PyJots<'py>(PyFloats<'py>, PyFloats<'py>);

impl PyJots<'_> {
    fn view(&self) -> PyResult<Jots<'_>> {
        Ok(Jots {
            efficiency: self.0.view()?,
            dark: self.1.view()?,
        })
    }
}

#[pyfunction]
#[pyo3(signature = (sensor, counts, trials, jots, out, threads))]
pub fn mle_from_counts(
    py: Python<'_>,
    sensor: Response,
    counts: PyReadonlyArray1<'_, i32>,
    trials: PyCounts<'_>,
    jots: PyJots<'_>,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response(sensor)?;
    let (trials, jots) = (trials.view()?, jots.view()?);
    let (counts, out) = (counts.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::from_counts(&response, counts, trials, &jots, out)
    })
}

#[pyfunction]
#[pyo3(signature = (sensor, counts, trials, jots, bits, reference, out, threads))]
#[allow(clippy::too_many_arguments)]
pub fn equivalent_counts(
    py: Python<'_>,
    sensor: Response,
    counts: PyReadonlyArray1<'_, i32>,
    trials: PyCounts<'_>,
    jots: PyJots<'_>,
    bits: i32,
    reference: PyJot,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response(sensor)?;
    let (trials, jots) = (trials.view()?, jots.view()?);
    let (counts, out) = (counts.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::equivalent_counts(&response, counts, trials, &jots, bits, jot(reference), out)
    })
}

#[pyfunction]
#[pyo3(signature = (sensor, probability, reference, out, threads))]
pub fn mle_from_probability(
    py: Python<'_>,
    sensor: Response,
    probability: PyReadonlyArray1<'_, f32>,
    reference: PyJot,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response(sensor)?;
    let (probability, out) = (probability.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::from_probability(&response, probability, jot(reference), out)
    })
}

#[pyfunction]
#[pyo3(signature = (sensor, ones, jots, dead, frames, side, width, out, threads))]
#[allow(clippy::too_many_arguments)]
pub fn mle_from_jots(
    py: Python<'_>,
    sensor: Response,
    ones: PyReadonlyArray1<'_, i32>,
    jots: PyJots<'_>,
    dead: Option<PyReadonlyArray1<'_, bool>>,
    frames: i32,
    side: usize,
    width: usize,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response(sensor)?;
    let counts = JotCounts {
        ones: ones.as_slice()?,
        jots: jots.view()?,
        dead: match &dead {
            Some(dead) => Some(dead.as_slice()?),
            None => None,
        },
        frames,
        side,
    };
    let out = out.as_slice_mut()?;
    run(py, threads, || {
        mle::from_jots(&response, &counts, width, out)
    })
}
