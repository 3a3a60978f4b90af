//! The instruction sets of the engine, and measurements of the processor's peak speed.

use jotlight::cpu::Level;
use jotlight::roofline;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::{run, to_python};

/// Return the names of the instruction sets that this processor supports.
#[pyfunction]
pub fn cpu_levels() -> Vec<&'static str> {
    Level::supported().into_iter().map(Level::name).collect()
}

/// Return the name of the current instruction set.
#[pyfunction]
pub fn cpu_level() -> &'static str {
    Level::current().name()
}

/// Set the instruction set by its name, or select the fastest one for `None`.
#[pyfunction]
pub fn choose_cpu_level(name: Option<&str>) -> PyResult<()> {
    Level::choose(name).map_err(to_python)
}

/// Run fused multiply-adds, and return the number of floating-point operations.
#[pyfunction]
pub fn multiply_adds(py: Python<'_>, rounds: usize, threads: Option<isize>) -> PyResult<u64> {
    run(py, threads, || Ok(roofline::multiply_adds(rounds)))
}

/// Return the wrapping sum of `words`.
#[pyfunction]
pub fn read_words(
    py: Python<'_>,
    words: PyReadonlyArray1<'_, u64>,
    threads: Option<isize>,
) -> PyResult<u64> {
    let words = words.as_slice().map_err(|_| {
        PyValueError::new_err("words: expected a contiguous array, got a strided one; copy it")
    })?;
    run(py, threads, || Ok(roofline::read_words(words)))
}
