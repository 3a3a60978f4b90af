//! Counts of the ones in packed bits.

use jotlight::bits::{self, Blocks, PackedBits};
use jotlight::error::Result;
use numpy::{
    PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadwriteArray1, PyReadwriteArray2,
    PyReadwriteArray3,
};
use pyo3::prelude::*;

use crate::{run, to_python};

/// Return the packed bits of each image.
pub fn packed_images<'a>(
    packed: &'a [PyReadonlyArray3<'_, u8>],
    width: usize,
) -> PyResult<Vec<PackedBits<'a>>> {
    let bits = |image: &'a PyReadonlyArray3<'_, u8>| PackedBits::new(image.as_array(), width);
    let images: Result<_> = packed.iter().map(bits).collect();
    images.map_err(to_python)
}

/// Add the number of ones of each pixel, over its jots and all frames, to `counts` `(N, H, W)`, for
/// the packed bits of each of N images.
#[pyfunction]
pub fn add_block_counts(
    py: Python<'_>,
    packed: Vec<PyReadonlyArray3<'_, u8>>,
    width: usize,
    oversampling: usize,
    valid: Option<PyReadonlyArray2<'_, u8>>,
    mut counts: PyReadwriteArray3<'_, i32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let counts = counts.as_array_mut();
    let valid = valid.as_ref().map(|valid| valid.as_array());
    let images = packed_images(&packed, width)?;
    run(py, threads, || {
        bits::add_block_counts_of_images(&images, oversampling, valid, counts)
    })
}

/// Add the number of ones of each square of jots in each block of frames to `counts`.
#[pyfunction]
pub fn add_counts_of_blocks(
    py: Python<'_>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    side: usize,
    before: usize,
    length: usize,
    weight: i32,
    mut counts: PyReadwriteArray3<'_, i32>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (packed, counts) = (packed.as_array(), counts.as_array_mut());
    let blocks = Blocks {
        before,
        length,
        weight,
    };
    run(py, threads, || {
        bits::add_counts_of_blocks(&PackedBits::new(packed, width)?, side, blocks, counts)
    })
}

/// Write packed frames with rows and columns exchanged to `transposed`.
#[pyfunction]
pub fn transpose_bits(
    py: Python<'_>,
    packed: PyReadonlyArray3<'_, u8>,
    width: usize,
    mut transposed: PyReadwriteArray3<'_, u8>,
    threads: Option<isize>,
) -> PyResult<()> {
    let (packed, transposed) = (packed.as_array(), transposed.as_array_mut());
    run(py, threads, || {
        bits::transpose(&PackedBits::new(packed, width)?, transposed)
    })
}

/// Reverse the order of the bits of each byte, in place.
#[pyfunction]
pub fn reverse_bytes(
    py: Python<'_>,
    mut packed: PyReadwriteArray1<'_, u8>,
    threads: Option<isize>,
) -> PyResult<()> {
    let packed = packed.as_array_mut();
    run(py, threads, || {
        bits::reverse_bytes(packed);
        Ok(())
    })
}

/// Set the bits at the positions that a list states for each frame, and return the next frame.
#[pyfunction]
pub fn set_positions(
    py: Python<'_>,
    positions: PyReadonlyArray1<'_, u32>,
    frame: i64,
    mut packed: PyReadwriteArray2<'_, u8>,
    threads: Option<isize>,
) -> PyResult<i64> {
    let (positions, packed) = (positions.as_slice()?, packed.as_array_mut());
    run(py, threads, || {
        bits::set_positions(positions, frame, packed)
    })
}
