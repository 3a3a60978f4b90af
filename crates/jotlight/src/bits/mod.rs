//! Packed bits, and the counts L of ones per pixel.
//!
//! T frames of H × W jots are stored as bytes `(T, H, ⌈W/8⌉)`. The first jot is the most
//! significant bit of a byte, as in `numpy.packbits`.

mod bit_planes;
mod blocks;
mod count;
mod layout;

use std::borrow::Cow;
use std::ops::Range;

use ndarray::{ArrayView1, ArrayView2, ArrayView3, s};

use crate::error::{Error, Result};

pub(crate) use bit_planes::{BitCounters, FRAMES_PER_GROUP};
pub use blocks::{Blocks, add_counts_of_blocks};
pub use count::{add_block_counts, add_block_counts_of_images};
pub(crate) use count::{check_mask, count_region, trials};
pub use layout::{reverse_bytes, set_positions, transpose};

/// Return the number of bytes of a packed row of `width` jots.
#[must_use]
pub fn packed_width(width: usize) -> usize {
    width.div_ceil(8)
}

/// The packed bits of all frames, and the width of a row in jots.
#[derive(Clone, Copy, Debug)]
pub struct PackedBits<'a> {
    bytes: ArrayView3<'a, u8>,
    width: usize,
}

impl<'a> PackedBits<'a> {
    /// Return the bits of rows of `width` jots. Padding bits in the last byte are ignored.
    ///
    /// # Errors
    /// [`Error::Shape`] if the number of bytes in a row is not ⌈`width`/8⌉.
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

    /// Return the numbers of frames, rows of jots, and columns of jots.
    #[must_use]
    pub fn shape(&self) -> (usize, usize, usize) {
        let (frames, rows, _) = self.bytes.dim();
        (frames, rows, self.width)
    }

    /// Return the bits of a range of frames.
    pub(crate) fn frames(&self, frames: Range<usize>) -> Self {
        let bytes = self.bytes.slice_move(s![frames, .., ..]);
        Self { bytes, ..*self }
    }

    /// Return the bits of a range of columns of jots that begins with a whole byte.
    pub(crate) fn columns(&self, columns: Range<usize>) -> Self {
        debug_assert!(columns.start.is_multiple_of(8));
        let bytes = columns.start / 8..columns.end.div_ceil(8);
        Self {
            bytes: self.bytes.slice_move(s![.., .., bytes]),
            width: columns.len(),
        }
    }

    pub(crate) fn row(&self, frame: usize, row: usize) -> Cow<'a, [u8]> {
        contiguous(self.bytes.slice_move(s![frame, row, ..]))
    }

    /// Return the bytes of a range of rows in a frame, row after row.
    pub(crate) fn rows(&self, frame: usize, rows: Range<usize>) -> Cow<'a, [u8]> {
        let part = self.bytes.slice_move(s![frame, rows, ..]);
        if let Some(bytes) = part.to_slice() {
            return Cow::Borrowed(bytes);
        }
        let mut bytes = Vec::with_capacity(part.len());
        for row in part.rows() {
            bytes.extend_from_slice(&contiguous(row));
        }
        Cow::Owned(bytes)
    }

    /// Return the numbers of rows and columns of pixels for blocks of K̂ × K̂ jots.
    ///
    /// # Errors
    /// [`Error::Range`] if K̂ = `oversampling` is 0, or does not divide the height and the width.
    pub(crate) fn pixel_shape(&self, oversampling: usize) -> Result<(usize, usize)> {
        let (_, rows, columns) = self.shape();
        if oversampling == 0 {
            return Err(Error::range("oversampling", "at least 1", oversampling));
        }
        if !rows.is_multiple_of(oversampling) || !columns.is_multiple_of(oversampling) {
            return Err(Error::range(
                "rows and columns of jots",
                format!("multiples of the oversampling {oversampling}"),
                format!("{rows} x {columns}"),
            ));
        }
        Ok((rows / oversampling, columns / oversampling))
    }
}

/// Return a row as a slice. Only a strided row is copied, such as a row of one color channel.
pub(crate) fn contiguous<T: Copy>(row: ArrayView1<'_, T>) -> Cow<'_, [T]> {
    match row.to_slice() {
        Some(slice) => Cow::Borrowed(slice),
        None => Cow::Owned(row.to_vec()),
    }
}

/// Return a row of a packed mask.
pub(crate) fn mask_row(mask: ArrayView2<'_, u8>, row: usize) -> Cow<'_, [u8]> {
    contiguous(mask.slice_move(s![row, ..]))
}

/// Return `length` bits, starting at bit `start`, as an integer. The last bit is the least
/// significant one.
///
/// `length` is at most [`MAX_FIELD_BITS`].
#[inline(always)]
pub(crate) fn bit_field(bytes: &[u8], start: usize, length: usize) -> u64 {
    debug_assert!(length <= MAX_FIELD_BITS);
    let first = start / 8;
    let word = if let Some(eight) = bytes[first..].first_chunk() {
        u64::from_be_bytes(*eight)
    } else if let Some(last) = bytes.last_chunk() {
        // Fewer than eight bytes remain. The shift appends zeros, which are never used.
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

/// Return the first eight bytes, with zeros past the end.
#[inline(always)]
fn first_word(bytes: &[u8]) -> [u8; 8] {
    bytes.first_chunk().copied().unwrap_or_else(|| {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        word
    })
}

/// The maximum `length` in [`bit_field`]: eight bytes hold that many bits after any `start`.
pub(crate) const MAX_FIELD_BITS: usize = 57;
