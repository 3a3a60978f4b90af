//! Counts of bits that follow a moving scene.

use jotlight::bits::PackedBits;
use jotlight::motion::{self, Displacements, ShiftedCounts};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use numpy::{PyReadwriteArray2, PyReadwriteArray3};
use pyo3::prelude::*;

use crate::run;

/// Count the ones of frames whose pixels are displaced, and add them to `ones` and the others.
///
/// `tile` is the width of the tiles of the fields, or None for a displacement of each pixel.
#[pyfunction]
#[pyo3(signature = (
    packed, width, first, last, tile, times, valid, ones, trials, remainders, threads
))]
#[allow(clippy::too_many_arguments)]
pub fn add_shifted_counts(
    py: Python<'_>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    first: PyReadonlyArray3<'_, f32>,
    last: PyReadonlyArray3<'_, f32>,
    tile: Option<usize>,
    times: PyReadonlyArray1<'_, f32>,
    valid: Option<PyReadonlyArray2<'_, u8>>,
    mut ones: PyReadwriteArray2<'_, i32>,
    mut trials: PyReadwriteArray2<'_, i32>,
    mut remainders: PyReadwriteArray3<'_, f32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let packed = packed.as_array();
    let (first, last) = (first.as_array(), last.as_array());
    let (times, valid) = (
        times.as_slice()?,
        valid.as_ref().map(|valid| valid.as_array()),
    );
    let sums = ShiftedCounts {
        ones: ones.as_array_mut(),
        trials: trials.as_array_mut(),
        remainders: remainders.as_array_mut(),
    };
    run(py, threads, || {
        let rows = packed.dim().1;
        motion::add_shifted_counts(
            &PackedBits::new(packed, width)?,
            &Displacements::new(first, last, tile, rows, width)?,
            times,
            valid,
            sums,
        )
    })
}
