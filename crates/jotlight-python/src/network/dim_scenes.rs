//! Corrections of the images of dim scenes, of dark regions, and of few photons.

use jotlight::likelihood::Threshold;
use jotlight::network::{self, Combined, LocalTrials, OfSquares, Pixels, Squares};
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use super::model::PySensorModel;
use super::trials::{PyTrials, to_engine_trials, trials_to_python};
use crate::arguments::{PyValues, ValueOrArray};
use crate::mle::PyJotResponses;
use crate::{run, to_python};

/// Return whether an image of intensities is so dark that trials may be combined.
#[pyfunction]
pub fn may_be_dim(
    image: PyReadonlyArray2<'_, f32>,
    sensor: PySensorModel,
    trials: f64,
) -> PyResult<bool> {
    Ok(sensor.to_engine()?.may_be_dim(image.as_array(), trials))
}

/// Return whether an image of intensities has dark pixels whose brightness would be wrong.
#[pyfunction]
pub fn may_have_dark_regions(
    image: PyReadonlyArray2<'_, f32>,
    sensor: PySensorModel,
) -> PyResult<bool> {
    Ok(sensor.to_engine()?.may_have_dark_regions(image.as_array()))
}

/// Return c, the number of trials per combined trial, or 1 for scenes that are not dim.
#[pyfunction]
pub fn trials_per_combined(
    fractions: PyReadonlyArray2<'_, f32>,
    trials: PyTrials<'_>,
    smallest: u32,
) -> f64 {
    network::trials_per_combined(fractions.as_array(), &to_engine(trials), smallest)
}

/// The trials of a dim scene, several of which are one.
#[pyclass(frozen, name = "Combined")]
pub struct PyCombined(Combined);

#[pymethods]
impl PyCombined {
    /// Return the combined trials of an image, or None for a scene that is not dim.
    #[staticmethod]
    fn of(
        fractions: PyReadonlyArray2<'_, f32>,
        trials: PyTrials<'_>,
        smallest: u32,
    ) -> PyResult<Option<Self>> {
        let combined = Combined::of(fractions.as_array(), &to_engine(trials), smallest);
        Ok(combined.map_err(to_python)?.map(Self))
    }

    /// The fractions of ones.
    #[getter]
    fn fractions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        self.0.fractions.clone().into_pyarray(py)
    }

    /// The local trials: one number, or a map.
    #[getter]
    fn trials(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        trials_to_python(py, self.0.trials.clone())
    }

    /// c, the number of trials per combined trial.
    #[getter]
    fn factor(&self) -> f32 {
        self.0.factor
    }

    /// Return the weight of these trials in each pixel, from their estimated probabilities.
    fn weights<'py>(
        &self,
        py: Python<'py>,
        probabilities: PyReadonlyArray2<'_, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let weights = self.0.weights(probabilities.as_array());
        Ok(weights.map_err(to_python)?.into_pyarray(py))
    }
}

/// Return probabilities of a one whose means in dark regions are those of the bits.
#[pyfunction]
pub fn match_dark_regions<'py>(
    py: Python<'py>,
    probabilities: PyReadonlyArray2<'_, f32>,
    fractions: PyReadonlyArray2<'_, f32>,
    trials: PyTrials<'_>,
    threshold: u32,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (probabilities, fractions) = (probabilities.as_array(), fractions.as_array());
    let (trials, threshold) = (
        to_engine(trials),
        Threshold::new(threshold).map_err(to_python)?,
    );
    let found = run(py, threads, || {
        network::match_dark_regions(probabilities, fractions, &trials, threshold)
    })?;
    Ok(found.into_pyarray(py))
}

fn to_engine(trials: PyTrials<'_>) -> LocalTrials {
    to_engine_trials(&[trials]).swap_remove(0)
}

/// Return whether an image of intensities gains from squares of pixels.
#[pyfunction]
pub fn has_few_photons(
    image: PyReadonlyArray2<'_, f32>,
    sensor: PySensorModel,
    trials: f64,
) -> PyResult<bool> {
    Ok(sensor
        .to_engine()?
        .has_few_photons(image.as_array(), trials))
}

/// The ones of squares, and their trials, efficiency, and dark counts: numbers or maps.
type PySquares<'py> = (Bound<'py, PyArray2<i32>>, Py<PyAny>, (Py<PyAny>, Py<PyAny>));

/// Return the counts of squares of 2 x 2 pixels.
#[pyfunction]
pub fn sum_counts<'py>(
    py: Python<'py>,
    counts: PyReadonlyArray2<'_, i32>,
    trials: PyValues<'_, f64>,
    jots: PyJotResponses<'_>,
    threshold: u32,
    threads: Option<isize>,
) -> PyResult<PySquares<'py>> {
    let pixels = Pixels {
        counts: counts.as_array(),
        trials: trials.to_engine()?,
        jots: jots.to_engine()?,
    };
    let threshold = Threshold::new(threshold).map_err(to_python)?;
    let squares = run(py, threads, || Squares::of(&pixels, threshold))?;
    let to_python = |values: OfSquares| -> PyResult<Py<PyAny>> {
        Ok(match values {
            OfSquares::Same(value) => value.into_pyobject(py)?.into_any().unbind(),
            OfSquares::Each(map) => map.into_pyarray(py).into_any().unbind(),
        })
    };
    Ok((
        squares.counts.into_pyarray(py),
        to_python(squares.trials)?,
        (
            to_python(squares.efficiency)?,
            to_python(squares.dark_counts)?,
        ),
    ))
}

/// Return an image that gains what squares of pixels say about its coarse structure.
#[pyfunction]
pub fn add_coarse<'py>(
    py: Python<'py>,
    fine: PyReadonlyArray2<'_, f32>,
    coarse: PyReadonlyArray2<'_, f32>,
    sensor: PySensorModel,
    trials: ValueOrArray<f64, PyReadonlyArray2<'_, f64>>,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (fine, coarse, sensor) = (fine.as_array(), coarse.as_array(), sensor.to_engine()?);
    let trials = match trials {
        ValueOrArray::Value(trials) => OfSquares::Same(trials),
        ValueOrArray::Array(map) => OfSquares::Each(map.as_array().to_owned()),
    };
    let found = run(py, threads, || {
        network::add_coarse(fine, coarse, &sensor, &trials)
    })?;
    Ok(found.into_pyarray(py))
}
