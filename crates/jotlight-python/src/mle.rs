//! Maximum-likelihood estimates for the box kernel.

use jotlight::bits::PackedBits;
use jotlight::likelihood::Threshold;
use jotlight::mle::{self, JotCounts, JotResponse, JotResponses, PixelResponse};
use jotlight::values::Values;
use numpy::{
    PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray1, PyReadwriteArray2,
};
use pyo3::prelude::*;

use crate::arguments::{PyValues, check_length};
use crate::{run, to_python};

/// The response of a pixel, as the tuple (threshold, light at intensity 1, maximum intensity).
#[derive(FromPyObject)]
pub struct PyPixelResponse(u32, f64, f64);

impl PyPixelResponse {
    pub fn to_engine(&self) -> PyResult<PixelResponse> {
        Ok(PixelResponse {
            threshold: Threshold::new(self.0).map_err(to_python)?,
            light_per_intensity: self.1,
            max_intensity: self.2,
        })
    }
}

/// The response that all jots share, as the tuple (efficiency, dark counts).
#[derive(FromPyObject)]
pub struct PyJotResponse(f64, f64);

impl PyJotResponse {
    pub fn to_engine(&self) -> JotResponse {
        JotResponse {
            efficiency: self.0,
            dark_counts: self.1,
        }
    }

    /// Return the response of all pixels.
    pub fn to_all(&self) -> JotResponses<'static> {
        JotResponses {
            efficiency: Values::Same(self.0),
            dark_counts: Values::Same(self.1),
        }
    }
}

/// The responses of jots or pixels, as the tuple (efficiency, dark counts).
#[derive(FromPyObject)]
pub struct PyJotResponses<'py>(PyValues<'py, f64>, PyValues<'py, f64>);

impl PyJotResponses<'_> {
    pub fn to_engine(&self) -> PyResult<JotResponses<'_>> {
        Ok(JotResponses {
            efficiency: self.0.to_engine()?,
            dark_counts: self.1.to_engine()?,
        })
    }
}

/// Write the estimate from the count of each pixel into `out`.
#[pyfunction]
pub fn mle_from_counts(
    py: Python<'_>,
    response: PyPixelResponse,
    counts: PyReadonlyArray1<'_, i32>,
    trials: PyValues<'_, f64>,
    jots: PyJotResponses<'_>,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response.to_engine()?;
    let (trials, jots) = (trials.to_engine()?, jots.to_engine()?);
    let (counts, out) = (counts.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::from_counts(&response, counts, trials, &jots, out)
    })
}

/// Write the value of the number of ones of each pixel into `out`.
#[pyfunction]
pub fn look_up_counts(
    py: Python<'_>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    oversampling: usize,
    table: PyReadonlyArray1<'_, f32>,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (packed, table, out) = (packed.as_array(), table.as_slice()?, out.as_array_mut());
    run(py, threads, || {
        mle::look_up_counts(&PackedBits::new(packed, width)?, oversampling, table, out)
    })
}

/// Write the expected count of an equivalent pixel for each pixel of the counts `(N, pixels)` into
/// `out`. Equivalent pixels of an image have the number of readings that `reference_trials` states,
/// and jots with the response `reference`.
#[pyfunction]
pub fn equivalent_counts(
    py: Python<'_>,
    response: PyPixelResponse,
    counts: PyReadonlyArray2<'_, i32>,
    trials: PyValues<'_, f64>,
    jots: PyJotResponses<'_>,
    reference_trials: PyReadonlyArray1<'_, f64>,
    reference: PyJotResponse,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (response, reference) = (response.to_engine()?, reference.to_engine());
    let (trials, jots) = (trials.to_engine()?, jots.to_engine()?);
    let reference_trials = reference_trials.as_slice()?;
    check_length(
        "reference trials",
        counts.as_array().dim().0,
        reference_trials.len(),
    )?;
    let (counts, out) = (counts.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::equivalent_counts(
            &response,
            counts,
            trials,
            &jots,
            reference_trials,
            reference,
            out,
        )
    })
}

/// Write the intensity for each detection probability into `out`.
#[pyfunction]
pub fn mle_from_probability(
    py: Python<'_>,
    response: PyPixelResponse,
    probability: PyReadonlyArray1<'_, f32>,
    jot: PyJotResponse,
    mut out: PyReadwriteArray1<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (response, jot) = (response.to_engine()?, jot.to_engine());
    let (probability, out) = (probability.as_slice()?, out.as_slice_mut()?);
    run(py, threads, || {
        mle::from_probability(&response, probability, jot, out)
    })
}

/// Write the estimate of each pixel into `out` `(N, pixels)`, where jots may differ in their
/// responses. `ones` `(N, jots)` belong to N images, and all other maps to each of them. `width` is
/// the number of pixels per row.
#[pyfunction]
pub fn mle_from_jots(
    py: Python<'_>,
    response: PyPixelResponse,
    ones: PyReadonlyArray2<'_, i32>,
    jots: PyJotResponses<'_>,
    dead: Option<PyReadonlyArray1<'_, bool>>,
    frames: i32,
    oversampling: usize,
    width: usize,
    mut out: PyReadwriteArray2<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let response = response.to_engine()?;
    let dead = dead.as_ref().map(PyReadonlyArray1::as_slice).transpose()?;
    let (images, pixels) = out.as_array().dim();
    check_length("ones", images, ones.as_array().dim().0)?;
    let size = (pixels.checked_div(width).unwrap_or_default(), width);
    check_length("rows of pixels", pixels, size.0 * size.1)?;
    let counts = JotCounts {
        ones: ones.as_slice()?,
        responses: jots.to_engine()?,
        dead,
        frames,
        oversampling,
    };
    let out = out.as_slice_mut()?;
    run(py, threads, || {
        mle::from_jots(&response, &counts, size, out)
    })
}
