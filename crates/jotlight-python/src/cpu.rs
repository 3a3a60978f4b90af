use jotlight::cpu::Level;
use jotlight::roofline;
use numpy::PyReadonlyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::{run, to_python};

#[pyfunction]
pub fn cpu_levels() -> Vec<&'static str> {
    Level::all().into_iter().map(Level::name).collect()
}

#[pyfunction]
pub fn cpu_level() -> &'static str {
    Level::current().name()
}

#[pyfunction]
#[pyo3(signature = (name))]
pub fn choose_cpu_level(name: Option<&str>) -> PyResult<()> {
    Level::choose(name).map_err(to_python)
}

#[pyfunction]
#[pyo3(signature = (rounds, threads))]
pub fn multiply_adds(py: Python<'_>, rounds: usize, threads: Option<isize>) -> PyResult<u64> {
    run(py, threads, || Ok(roofline::multiply_adds(rounds)))
}

#[pyfunction]
#[pyo3(signature = (words, threads))]
pub fn read_words(
    py: Python<'_>,
    words: PyReadonlyArray1<'_, u64>,
    threads: Option<isize>,
) -> PyResult<u64> {
    let words = words
        .as_slice()
        .map_err(|_| PyValueError::new_err("words: expected them in one piece"))?;
    run(py, threads, || Ok(roofline::read(words)))
}
