//! Splines without filters. PyTorch networks use them as their nonlinearities.

use jotlight::error::Result;
use jotlight::network::{Compiled, Splines};
use numpy::{Element, IntoPyArray, PyArray2, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arguments::{Precision, for_precision};
use crate::{run, to_python};

/// Planes (N, C, P) and spline coefficients (C, `N_w`).
type PlanesAndCoefficients<'py, F> = (PyReadonlyArray3<'py, F>, PyReadonlyArray2<'py, F>);

type PyPlanes<'py> = Precision<PlanesAndCoefficients<'py, f32>, PlanesAndCoefficients<'py, f64>>;

/// The maximum number of values that the calling thread processes itself, if one thread is allowed.
///
/// On a busy machine, waking another thread takes longer than the work on the patches of a training
/// step. Ctrl-C waits at most some tens of milliseconds for this number of values.
const MAX_OWN_VALUES: usize = 1 << 24;

/// The gradients with respect to planes and coefficients.
type PyGradients<'py> = (Bound<'py, PyAny>, Bound<'py, PyArray2<f64>>);

/// Apply the spline of each channel to planes, and return the results.
#[pyfunction]
pub fn activate<'py>(
    py: Python<'py>,
    planes: PyPlanes<'py>,
    start: f64,
    spacing: f64,
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyAny>> {
    for_precision!(planes, planes => activate_planes(py, planes, (start, spacing), threads))
}

fn activate_planes<'py, F: Compiled + Element>(
    py: Python<'py>,
    (planes, coefficients): PlanesAndCoefficients<'_, F>,
    (start, spacing): (f64, f64),
    threads: Option<isize>,
) -> PyResult<Bound<'py, PyAny>> {
    let (planes, coefficients) = (planes.as_array(), coefficients.as_array());
    let out = run_splines(py, threads, planes.len(), || {
        let splines = Splines::new(coefficients, F::from_f64(start), F::from_f64(spacing))?;
        F::activate(&splines, planes)
    })?;
    Ok(out.into_pyarray(py).into_any())
}

/// Return the gradients with respect to planes and coefficients. `gradient` is the gradient with
/// respect to the result of `activate`.
#[pyfunction]
pub fn activate_backward<'py>(
    py: Python<'py>,
    planes: PyPlanes<'py>,
    gradient: &Bound<'py, PyAny>,
    start: f64,
    spacing: f64,
    threads: Option<isize>,
) -> PyResult<PyGradients<'py>> {
    for_precision!(planes, planes => pull_back(py, planes, gradient, (start, spacing), threads))
}

fn pull_back<'py, F: Compiled + Element>(
    py: Python<'py>,
    (planes, coefficients): PlanesAndCoefficients<'_, F>,
    gradient: &Bound<'py, PyAny>,
    (start, spacing): (f64, f64),
    threads: Option<isize>,
) -> PyResult<PyGradients<'py>> {
    let gradient: PyReadonlyArray3<'_, F> = gradient.extract().map_err(|_| {
        PyValueError::new_err(
            "gradient: expected an array (N, C, P) with the data type of the planes",
        )
    })?;
    let (planes, coefficients) = (planes.as_array(), coefficients.as_array());
    let gradient = gradient.as_array();
    let (out, sums) = run_splines(py, threads, planes.len(), || {
        let splines = Splines::new(coefficients, F::from_f64(start), F::from_f64(spacing))?;
        F::pull_back(&splines, planes, gradient)
    })?;
    Ok((out.into_pyarray(py).into_any(), sums.into_pyarray(py)))
}

/// Run work on a number of values, in a pool of threads or in the calling thread.
fn run_splines<R: Send>(
    py: Python<'_>,
    threads: Option<isize>,
    values: usize,
    work: impl FnOnce() -> Result<R> + Send,
) -> PyResult<R> {
    if threads == Some(1) && values <= MAX_OWN_VALUES {
        return py.detach(work).map_err(to_python);
    }
    run(py, threads, work)
}
