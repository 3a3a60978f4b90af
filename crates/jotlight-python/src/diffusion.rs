//! Rounding of real counts such that the errors of neighbors cancel.

use jotlight::diffusion;
use numpy::{PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;

use crate::run;

/// Write whole numbers with about the same sums along the rows into `out`, all `(H, W)`.
#[pyfunction]
pub fn diffuse(
    py: Python<'_>,
    values: PyReadonlyArray2<'_, f64>,
    is_known: PyReadonlyArray2<'_, bool>,
    mut out: PyReadwriteArray2<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (values, is_known, out) = (values.as_array(), is_known.as_array(), out.as_array_mut());
    run(py, threads, || diffusion::diffuse(values, is_known, out))
}
