//! Packed bits `(T, H, ⌈W/8⌉)`, most significant bit first, as `numpy.packbits` lays them out.

mod count;
mod planes;

use std::borrow::Cow;
use std::ops::Range;

use ndarray::{ArrayView1, ArrayView2, ArrayView3, s};

use crate::error::{Error, Result};

pub use count::add_block_counts;
pub(crate) use count::check_mask;

/// Bytes of a packed row of `width` jots.
#[must_use]
pub fn packed_width(width: usize) -> usize {
    width.div_ceil(8)
}

/// The bits of all frames, with the true width of a row.
#[derive(Clone, Copy, Debug)]
pub struct PackedBits<'a> {
    bytes: ArrayView3<'a, u8>,
    width: usize,
}

impl<'a> PackedBits<'a> {
    /// Bits of rows that are `width` jots wide; what the last byte holds past that is never read.
    ///
    /// # Errors
    /// [`Error::Shape`] when the bytes of a row do not hold `width` bits.
    pub fn new(bytes: ArrayView3<'a, u8>, width: usize) -> Result<Self> {
        if bytes.dim().2 != packed_width(width) {
            return Err(Error::shape(
                "bytes in a packed row",
                packed_width(width),
                bytes.dim().2,
            ));
        }
        Ok(Self { bytes, width })
    }

    /// Frames, rows and columns of jots.
    #[must_use]
    pub fn shape(&self) -> (usize, usize, usize) {
        let (frames, rows, _) = self.bytes.dim();
        (frames, rows, self.width)
    }

    pub(crate) fn row(&self, frame: usize, row: usize) -> Cow<'a, [u8]> {
        contiguous(self.bytes.slice_move(s![frame, row, ..]))
    }

    /// The bytes of some rows of a frame, one row after the other.
    pub(crate) fn rows(&self, frame: usize, rows: Range<usize>) -> Cow<'a, [u8]> {
        let part = self.bytes.slice_move(s![frame, rows, ..]);
        match part.to_slice() {
            Some(bytes) => Cow::Borrowed(bytes),
            None => Cow::Owned(part.iter().copied().collect()),
        }
    }

    /// Rows and columns of pixels for blocks of `side` × `side` jots.
    ///
    /// # Errors
    /// [`Error::Shape`] when the blocks do not fill the frame.
    pub(crate) fn pixels(&self, side: usize) -> Result<(usize, usize)> {
        let (_, rows, columns) = self.shape();
        if side == 0 {
            return Err(Error::range("oversampling", "at least 1", side));
        }
        if !rows.is_multiple_of(side) || !columns.is_multiple_of(side) {
            return Err(Error::shape(
                "rows and columns of jots",
                format!("multiples of the oversampling {side}"),
                (rows, columns),
            ));
        }
        Ok((rows / side, columns / side))
    }
}

/// A row in one piece, which loops run over fastest; only a row that is strided, as one colour of many is, gets copied.
pub(crate) fn contiguous<T: Copy>(row: ArrayView1<'_, T>) -> Cow<'_, [T]> {
    match row.to_slice() {
        Some(slice) => Cow::Borrowed(slice),
        None => Cow::Owned(row.to_vec()),
    }
}

/// The row of a packed mask.
pub(crate) fn mask_row(mask: ArrayView2<'_, u8>, row: usize) -> Cow<'_, [u8]> {
    contiguous(mask.slice_move(s![row, ..]))
}

/// Up to 57 bits from bit `start` on, the first as the most significant of the result's lowest `length` bits.
#[inline(always)]
pub(crate) fn field(bytes: &[u8], start: usize, length: usize) -> u64 {
    debug_assert!(length <= 57);
    let first = start / 8;
    let word = if let Some(eight) = bytes[first..].first_chunk() {
        u64::from_be_bytes(*eight)
    } else if let Some(last) = bytes.last_chunk() {
        // The row ends within these eight bytes, and what follows it is never read.
        u64::from_be_bytes(*last) << (8 * (first + 8 - bytes.len()))
    } else {
        let mut eight = [0u8; 8];
        eight[..bytes.len() - first].copy_from_slice(&bytes[first..]);
        u64::from_be_bytes(eight)
    } << (start % 8);
    if length == 0 {
        0
    } else {
        word >> (64 - length)
    }
}

/// The longest field that [`field`] reads wherever it starts.
pub(crate) const FIELD: usize = 57;
