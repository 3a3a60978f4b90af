//! The numbers of trials that condition networks: levels, weights, and local trials.

use jotlight::error::Result;
use jotlight::network::{self, LocalTrials};
use ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::{run, to_python};

/// The local trials of an image: one number, or a map.
#[derive(FromPyObject)]
pub enum PyTrials<'py> {
    Same(u32),
    Map(PyReadonlyArray2<'py, f32>),
}

/// Return the local trials of images. Images with the same array share a map.
pub fn to_engine_trials(trials: &[PyTrials<'_>]) -> Vec<LocalTrials> {
    let mut maps = Vec::new();
    let convert = |trials: &PyTrials<'_>| match trials {
        PyTrials::Same(trials) => LocalTrials::Same(*trials),
        PyTrials::Map(map) => {
            let map = map.as_array();
            let key = (map.as_ptr(), map.shape().to_vec(), map.strides().to_vec());
            if let Some((_, known)) = maps.iter().find(|(other, _)| *other == key) {
                return LocalTrials::clone(known);
            }
            let shared = LocalTrials::Map(map.to_owned().into_shared());
            maps.push((key, shared.clone()));
            shared
        }
    };
    trials.iter().map(convert).collect()
}

/// Return the weight of each of M = `sets` parameter sets for K = `trials`.
#[pyfunction]
pub fn conditioning_weights(
    py: Python<'_>,
    trials: f64,
    trials_range: (f64, f64),
    sets: usize,
) -> PyResult<Bound<'_, PyArray1<f64>>> {
    let weights = network::conditioning_weights(trials, trials_range, sets);
    Ok(weights.map_err(to_python)?.into_pyarray(py))
}

/// The levels of a map, and their weights at each pixel.
type PyLevels<'py> = Vec<(u32, Bound<'py, PyArray2<f32>>)>;

/// Return the levels of maps of trials, and their weights at each pixel.
#[pyfunction]
pub fn level_weights<'py>(
    py: Python<'py>,
    maps: Vec<PyReadonlyArray2<'_, f32>>,
) -> PyResult<Vec<PyLevels<'py>>> {
    let maps: Vec<_> = maps.iter().map(PyReadonlyArray2::as_array).collect();
    let weigh = || maps.into_iter().map(network::level_weights).collect();
    let found: Result<Vec<_>> = py.detach(weigh);
    let to_arrays = |levels: Vec<(u32, Array2<f32>)>| {
        let levels = levels.into_iter();
        let levels = levels.map(|(level, weights)| (level, weights.into_pyarray(py)));
        levels.collect()
    };
    let found = found.map_err(to_python)?;
    Ok(found.into_iter().map(to_arrays).collect())
}

/// Return the number of trials that states the noise around each pixel of each map: one number, or a
/// map.
#[pyfunction]
pub fn local_trials(
    py: Python<'_>,
    maps: Vec<PyReadonlyArray2<'_, f64>>,
    threads: Option<isize>,
) -> PyResult<Vec<Py<PyAny>>> {
    let maps: Vec<_> = maps.iter().map(PyReadonlyArray2::as_array).collect();
    let found: Vec<LocalTrials> = run(py, threads, || {
        maps.into_iter().map(network::local_trials).collect()
    })?;
    let found = found.into_iter();
    found.map(|trials| trials_to_python(py, trials)).collect()
}

/// Return local trials as one number, or a map.
pub fn trials_to_python(py: Python<'_>, trials: LocalTrials) -> PyResult<Py<PyAny>> {
    match trials {
        LocalTrials::Same(trials) => Ok(trials.into_pyobject(py)?.into_any().unbind()),
        LocalTrials::Map(map) => Ok(map.into_owned().into_pyarray(py).into_any().unbind()),
    }
}
