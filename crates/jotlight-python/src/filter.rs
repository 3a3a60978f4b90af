//! Filters of images.

use jotlight::{color_lines as lines, filter};
use numpy::{PyReadonlyArray3, PyReadwriteArray3};
use pyo3::prelude::*;

use crate::run;

/// Write images into `out` after a Gaussian filter.
#[pyfunction]
pub fn blur(
    py: Python<'_>,
    images: PyReadonlyArray3<'_, f32>,
    sigma: f64,
    mut out: PyReadwriteArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (images, out) = (images.as_array(), out.as_array_mut());
    run(py, threads, || filter::blur(images, sigma, out))
}

/// Write colors, whose differences follow their light, into `out`.
#[pyfunction]
pub fn color_lines(
    py: Python<'_>,
    colors: PyReadonlyArray3<'_, f32>,
    mut out: PyReadwriteArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (colors, out) = (colors.as_array(), out.as_array_mut());
    run(py, threads, || lines::color_lines(colors, out))
}
