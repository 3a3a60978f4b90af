//! Corrections of the images of dim scenes and of dark regions.

use jotlight::likelihood::Threshold;
use jotlight::network::{self, Combined, LocalTrials};
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use super::model::PySensorModel;
use super::trials::{PyTrials, to_engine_trials, trials_to_python};
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
