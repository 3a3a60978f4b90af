//! Copies of bits from shifted places.

use std::ops::Range;

use super::lines::{BLOCK, BLOCKS_PER_STEP, Blocks};
use crate::bits::{bit_field, copy_bytes};

/// The size of the frames that bits are copied from.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    pub rows: usize,
    pub columns: usize,
}

/// Where the bits of each block of a step come from, if all bits of a block have the same shift.
#[derive(Clone, Default)]
pub(super) struct Origins {
    /// The byte of the frame with the first bit inside it, and the number of bits before this bit.
    bytes: Blocks<u32>,
    bits_before: Blocks<i32>,
    /// The number of bits after the last one of a block in a word of 32 bits. Bits from outside the
    /// frame come before its first bit.
    bits_after: Blocks<i32>,
    /// The pixels whose bits come from inside the frame. The first pixel is the highest bit.
    pub inside: Blocks<i32>,
}

impl Origins {
    /// Return the bits of a block. Those from outside the frame are 0.
    #[inline(always)]
    pub fn bits(&self, source: &[u8], block: usize) -> u16 {
        let first = self.bytes[block] as usize;
        let word = match source.get(first..first + 4) {
            Some(four) => u32::from_be_bytes([four[0], four[1], four[2], four[3]]),
            None => last_word(&source[first..]),
        };
        let bits = word << (self.bits_before[block] & 31) >> (self.bits_after[block] & 31);
        bits as u16 & self.inside[block] as u16
    }
}

/// Return up to three bytes, with zeros past the end.
#[cold]
fn last_word(bytes: &[u8]) -> u32 {
    let mut word = [0; 4];
    word[..bytes.len()].copy_from_slice(bytes);
    u32::from_be_bytes(word)
}

impl Frame {
    /// Return the number of bytes of a row.
    pub fn row_bytes(self) -> usize {
        self.columns.div_ceil(8)
    }

    /// Return where the blocks of a step of a row come from, if its first column is `column`.
    #[inline(always)]
    pub fn origins(self, row: usize, column: usize, shifts: &[Blocks<i32>; 2]) -> Origins {
        let (rows, columns) = (self.rows as i32, self.columns as i32);
        let row_bytes = self.row_bytes() as i32;
        let mut origins = Origins::default();
        for i in 0..BLOCKS_PER_STEP {
            let row = row as i32 + shifts[0][i];
            let before_shift = (column + i * BLOCK) as i32;
            let column = before_shift + shifts[1][i];
            let skipped = (-column).clamp(0, BLOCK as i32);
            let length = (columns - before_shift)
                .min(columns - column)
                .clamp(0, BLOCK as i32);
            let is_inside = row >= 0 && row < rows && column < columns && skipped < length;
            let start = if is_inside { column + skipped } else { 0 };
            let row_start = if is_inside { row * row_bytes } else { 0 };
            origins.bytes[i] = (row_start + (start >> 3)) as u32;
            origins.bits_before[i] = start & 7;
            origins.bits_after[i] = 16 + (skipped & 15);
            let inside = (0xffff >> skipped) & !(0xffff >> length);
            origins.inside[i] = if is_inside { inside } else { 0 };
        }
        origins
    }

    /// Return the columns of a row that come from inside the frame, if all have the same shift.
    #[inline(always)]
    pub fn columns_inside(self, row: usize, shift: [i32; 2]) -> Range<usize> {
        let row = row.checked_add_signed(shift[0] as isize);
        if row.is_none_or(|row| row >= self.rows) {
            return 0..0;
        }
        let shift = shift[1] as isize;
        let start = 0usize.saturating_add_signed(-shift).min(self.columns);
        let end = self.columns.saturating_add_signed(-shift).min(self.columns);
        start..end.max(start)
    }

    /// Copy `columns` of a row with the same shift. They come from inside the frame. The other
    /// columns become 0.
    #[inline(always)]
    pub fn copy_row(
        self,
        source: &[u8],
        row: usize,
        shift: [i32; 2],
        columns: Range<usize>,
        target: &mut [u8],
    ) {
        if columns.is_empty() {
            target.fill(0);
            return;
        }
        let row_start = (row as i64 + i64::from(shift[0])) * 8 * self.row_bytes() as i64;
        let place = |column: usize| (row_start + column as i64 + i64::from(shift[1])) as usize;
        let bytes = columns.start.div_ceil(8)..columns.end / 8;
        if bytes.start > bytes.end {
            // All columns are in the same byte.
            target.fill(0);
            let field = bit_field(source, place(columns.start), columns.len()) as u8;
            target[bytes.end] = field << (8 - columns.end % 8);
            return;
        }
        target[..bytes.start].fill(0);
        target[bytes.end..].fill(0);
        let before = 8 * bytes.start - columns.start;
        if before > 0 {
            target[bytes.start - 1] = bit_field(source, place(columns.start), before) as u8;
        }
        let after = columns.end - 8 * bytes.end;
        if after > 0 {
            let field = bit_field(source, place(8 * bytes.end), after) as u8;
            target[bytes.end] = field << (8 - after);
        }
        if !bytes.is_empty() {
            copy_bytes(source, place(8 * bytes.start), &mut target[bytes]);
        }
    }
}

/// Where the bits of the pixels of a block come from, if each pixel has its own shift.
pub(super) struct PixelOrigins {
    /// The byte of the frame with the bit of each pixel, or 0 if it is outside.
    bytes: [u32; BLOCK],
    /// The number of bits after this bit in its byte.
    bits_after: [u32; BLOCK],
    /// 1 for each pixel inside the frame, and 0 for the others.
    pub are_inside: [u32; BLOCK],
}

impl PixelOrigins {
    /// Return the origins of the first `length` pixels of a block. The others come from outside.
    #[inline(always)]
    pub fn new(
        frame: Frame,
        row: usize,
        column: usize,
        length: usize,
        shifts: &[[i32; BLOCK]; 2],
    ) -> Self {
        let [rows_shifts, column_shifts] = *shifts;
        let (rows, columns) = (frame.rows as u32, frame.columns as u32);
        let row_bytes = frame.row_bytes() as u32;
        let mut origins = Self {
            bytes: [0; BLOCK],
            bits_after: [0; BLOCK],
            are_inside: [0; BLOCK],
        };
        for pixel in 0..BLOCK {
            // Negative numbers become large ones.
            let row = (row as u32).wrapping_add_signed(rows_shifts[pixel]);
            let column = ((column + pixel) as u32).wrapping_add_signed(column_shifts[pixel]);
            let is_inside = row < rows && column < columns && pixel < length;
            let byte = row.wrapping_mul(row_bytes).wrapping_add(column >> 3);
            origins.bytes[pixel] = if is_inside { byte } else { 0 };
            origins.bits_after[pixel] = !column & 7;
            origins.are_inside[pixel] = u32::from(is_inside);
        }
        origins
    }

    /// Return the bits of the pixels. Those from outside the frame are 0.
    #[inline(always)]
    pub fn bits(&self, source: &[u8]) -> u16 {
        let mut bits = 0;
        for pixel in 0..BLOCK {
            let byte = u32::from(source[self.bytes[pixel] as usize]);
            bits = bits << 1 | byte >> (self.bits_after[pixel] & 31) & self.are_inside[pixel];
        }
        bits as u16
    }
}
