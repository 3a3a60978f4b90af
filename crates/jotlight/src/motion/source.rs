//! Copies of bits from shifted places.

use std::ops::Range;

use super::lines::{BLOCK, BLOCKS_PER_STEP, Blocks};

/// The number of bits in a word.
pub(super) const WORD: usize = 64;

/// The number of words in a step.
pub(super) const WORDS_PER_STEP: usize = BLOCKS_PER_STEP * BLOCK / WORD;

/// The bits of a step.
pub(super) type Words = [u64; WORDS_PER_STEP];

/// The size of the frames that bits are copied from.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    pub rows: usize,
    pub columns: usize,
}

/// Where the bits of each block of a step come from, if all bits of a block have the same shift.
#[derive(Clone, Default)]
pub(super) struct Origins {
    /// The byte of the frame with the first bit inside it.
    bytes: Blocks<u32>,
    /// The number of bits after the last one of a block in a word of 32 bits from this byte. Bits
    /// from outside the frame come before its first bit.
    bits_after: Blocks<i32>,
    /// The pixels whose bits come from inside the frame. The first pixel is the highest bit.
    pub inside: Blocks<i32>,
}

impl Origins {
    /// Return the bits of a step. Those from outside the frame are 0.
    #[inline(always)]
    pub fn words(&self, source: &[u8]) -> Words {
        let mut words = [0; WORDS_PER_STEP];
        for (index, word) in words.iter_mut().enumerate() {
            for block in 0..WORD / BLOCK {
                *word = *word << BLOCK | self.bits(source, index * (WORD / BLOCK) + block);
            }
        }
        words
    }

    /// Return the bits of a block. Those from outside the frame are 0.
    #[inline(always)]
    fn bits(&self, source: &[u8], block: usize) -> u64 {
        let first = self.bytes[block] as usize;
        let word = match source[first..].first_chunk() {
            Some(four) => u32::from_be_bytes(*four),
            None => (last_word(&source[first..]) >> 32) as u32,
        };
        u64::from(word >> (self.bits_after[block] & 31) & self.inside[block] as u32)
    }
}

/// Return 64 bits after the first `start` bits, with zeros past the end.
#[inline(always)]
fn read_word(source: &[u8], start: usize) -> u64 {
    let bytes = &source[start / 8..];
    let [left, right] = match bytes.first_chunk::<9>() {
        Some(&[a, b, c, d, e, f, g, h, i]) => {
            [[a, b, c, d, e, f, g, h], [b, c, d, e, f, g, h, i]].map(u64::from_be_bytes)
        }
        None => [last_word(bytes), last_word(&bytes[1.min(bytes.len())..])],
    };
    join(left, right, start % 8)
}

/// Return the bits after the first `shift` ones of two words, the second of which begins a byte
/// later.
#[inline(always)]
fn join(left: u64, right: u64, shift: usize) -> u64 {
    left << shift | right >> (8 - shift)
}

/// Return up to eight bytes, with zeros past the end.
#[cold]
fn last_word(bytes: &[u8]) -> u64 {
    let mut word = [0; 8];
    let length = bytes.len().min(8);
    word[..length].copy_from_slice(&bytes[..length]);
    u64::from_be_bytes(word)
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
            origins.bits_after[i] = 16 - (start & 7) + (skipped & 15);
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
        target: &mut [[u8; WORD / 8]],
    ) {
        if columns.is_empty() {
            target.fill([0; WORD / 8]);
            return;
        }
        let row_start = (row as i64 + i64::from(shift[0])) * 8 * self.row_bytes() as i64;
        let place = |column: usize| row_start + column as i64 + i64::from(shift[1]);
        let bytes = target.len() * WORD / 8;
        match usize::try_from(place(0)) {
            // Bits of other rows are removed later.
            Ok(start) if start / 8 + bytes < source.len() => copy_words(source, start, target),
            _ => {
                for (index, word) in target.iter_mut().enumerate() {
                    let first = columns.start.max(index * WORD);
                    let is_inside = first < columns.end.min((index + 1) * WORD);
                    *word = [0; WORD / 8];
                    if is_inside {
                        let bits = read_word(source, place(first) as usize);
                        *word = (bits >> (first - index * WORD)).to_be_bytes();
                    }
                }
            }
        }
        keep(columns, target);
    }
}

/// Set the bits of all columns but some to 0.
#[inline(always)]
fn keep(columns: Range<usize>, target: &mut [[u8; WORD / 8]]) {
    let mut mask = |index: usize, mask: u64| {
        target[index] = (u64::from_be_bytes(target[index]) & mask).to_be_bytes();
    };
    let (first, last) = (columns.start / WORD, columns.end / WORD);
    mask(first, u64::MAX >> (columns.start % WORD));
    if !columns.end.is_multiple_of(WORD) {
        mask(last, !(u64::MAX >> (columns.end % WORD)));
    }
    target[..first].fill([0; WORD / 8]);
    target[columns.end.div_ceil(WORD)..].fill([0; WORD / 8]);
}

/// Copy words after the first `start` bits. A byte must follow them.
#[inline(always)]
fn copy_words(source: &[u8], start: usize, target: &mut [[u8; WORD / 8]]) {
    let (first, shift) = (start / 8, start % 8);
    let bytes = target.len() * WORD / 8;
    let (left, right) = (&source[first..][..bytes], &source[first + 1..][..bytes]);
    let pairs = left.as_chunks().0.iter().zip(right.as_chunks().0);
    for (word, (left, right)) in target.iter_mut().zip(pairs) {
        let [left, right] = [left, right].map(|bytes| u64::from_be_bytes(*bytes));
        *word = join(left, right, shift).to_be_bytes();
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
