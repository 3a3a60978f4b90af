//! Maximum likelihood of readings with different gains and thresholds.

use jotlight::joint::{JointReadings, Term, TermCells};
use jotlight::multibit::Response;
use numpy::{PyReadonlyArray1, PyReadwriteArray1};
use pyo3::prelude::*;

use crate::likelihood::PyReadings;
use crate::multibit::{PyCells, PyResponse};
use crate::{run, to_python};

/// The cells of a term: a tuple of bits, or (response, cells, number) for several bits.
#[derive(FromPyObject)]
pub enum PyTermCells<'py> {
    Bits(PyReadings<'py>),
    Several((PyResponse, PyCells<'py>, usize)),
}

/// A term, as the tuple (cells, light at intensity 1, cells per pixel and dimension, places).
#[derive(FromPyObject)]
pub struct PyTerm<'py>(
    PyTermCells<'py>,
    f64,
    usize,
    Option<PyReadonlyArray1<'py, i32>>,
);

/// Return the responses of the terms. Cells borrow them.
fn responses(terms: &[PyTerm<'_>]) -> PyResult<Vec<Option<Response>>> {
    let each = terms.iter().map(|PyTerm(cells, ..)| match cells {
        PyTermCells::Bits(_) => Ok(None),
        PyTermCells::Several((response, ..)) => response.to_engine().map(Some),
    });
    each.collect()
}

fn to_engine<'a>(
    terms: &'a [PyTerm<'_>],
    responses: &'a [Option<Response>],
    (height, width): (usize, usize),
) -> PyResult<JointReadings<'a>> {
    let pairs = terms.iter().zip(responses);
    let each = pairs.map(|(PyTerm(cells, light, side, places), response)| {
        let cells = match (cells, response) {
            (PyTermCells::Several((_, cells, number)), Some(response)) => {
                TermCells::Several(cells.to_engine(response, *number)?)
            }
            (PyTermCells::Several(_), None) => unreachable!("each has a response"),
            (PyTermCells::Bits(readings), _) => TermCells::Bits(readings.to_engine()?),
        };
        let places = places
            .as_ref()
            .map(PyReadonlyArray1::as_slice)
            .transpose()?;
        Ok(Term {
            cells,
            light: *light,
            side: *side,
            places,
        })
    });
    let terms = each.collect::<PyResult<Vec<_>>>()?;
    JointReadings::new(terms, height, width).map_err(to_python)
}

/// Replace `intensity`, the first guess of each pixel, with the maximum of the likelihood in
/// [0, `highest`].
#[pyfunction]
pub fn joint_maximum(
    py: Python<'_>,
    terms: Vec<PyTerm<'_>>,
    shape: (usize, usize),
    highest: f64,
    offset: f64,
    mut intensity: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let responses = responses(&terms)?;
    let joint = to_engine(&terms, &responses, shape)?;
    let intensity = intensity.as_slice_mut()?;
    run(py, threads, || joint.maximize(highest, offset, intensity))
}

/// Replace `intensity`, the first guess of each pixel, with the intensity in [0, `highest`] at which
/// the expected sum of the readings is `total`.
#[pyfunction]
pub fn joint_solution(
    py: Python<'_>,
    terms: Vec<PyTerm<'_>>,
    shape: (usize, usize),
    total: PyReadonlyArray1<'_, f64>,
    highest: f64,
    offset: f64,
    mut intensity: PyReadwriteArray1<'_, f64>,
    threads: Option<isize>,
) -> PyResult<()> {
    let responses = responses(&terms)?;
    let joint = to_engine(&terms, &responses, shape)?;
    let (total, intensity) = (total.as_slice()?, intensity.as_slice_mut()?);
    run(py, threads, || {
        joint.solve_total(total, highest, offset, intensity)
    })
}
