//! Changes of the layout of packed bits, as cameras store them.

use ndarray::{ArrayViewMut1, ArrayViewMut2, ArrayViewMut3, Axis, s};
use rayon::prelude::*;

use super::{PackedBits, first_word, packed_width};
use crate::cpu::{self, Simd, WithSimd, levels};
use crate::error::{Error, Result};
use crate::interrupt;

/// The numbers of rows and columns of the squares of bits that are transposed at once.
const SIDE: usize = 64;

/// The number of bytes of a row of such a square.
const SIDE_BYTES: usize = SIDE / 8;

/// The number of squares, one below the other, that are transposed together in vector registers.
const LANES: usize = 4;

/// The number of numbers that are searched together.
const NUMBERS_PER_CHUNK: usize = 64;

/// The minimum number of bytes that one task reverses. This takes longer than starting the task.
const BYTES_PER_TASK: usize = 1 << 16;

/// Write frames with rows and columns exchanged to `transposed` `(T, W, ⌈H/8⌉)`.
///
/// Padding bits become 0.
///
/// # Errors
/// [`Error::Shape`] if the shape of `transposed` does not match.
pub fn transpose(bits: &PackedBits<'_>, mut transposed: ArrayViewMut3<'_, u8>) -> Result<()> {
    let (frames, height, width) = bits.shape();
    let shape = (frames, width, packed_width(height));
    if transposed.dim() != shape {
        return Err(Error::shape("transposed bits", shape, transposed.dim()));
    }
    transposed
        .axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .for_each(|(frame, transposed)| {
            if !interrupt::is_requested() {
                let bytes = bits.rows(frame, 0..height);
                cpu::run_below_v4(TransposeFrame {
                    bytes: &bytes,
                    row_bytes: packed_width(width),
                    transposed,
                });
            }
        });
    Ok(())
}

/// Reverse the order of the bits of each byte.
pub fn reverse_bytes(mut bytes: ArrayViewMut1<'_, u8>) {
    bytes
        .axis_chunks_iter_mut(Axis(0), BYTES_PER_TASK)
        .into_par_iter()
        .for_each(|mut part| match part.as_slice_mut() {
            Some(part) => reverse(part),
            None => part.map_inplace(|byte| *byte = byte.reverse_bits()),
        });
}

/// Set the bits at the positions that a list states for each frame.
///
/// Each frame of `packed` `(n, bytes)` is one sequence of bits. After the positions of each frame,
/// the list has the number of bits of a frame. The first position belongs to frame `frame`, which
/// may be negative; positions of frames that are not in `packed` are ignored.
///
/// Return the number of the frame to which the next position after the list belongs.
///
/// # Errors
/// [`Error::Range`] if a position is larger than the number of bits of a frame. The frames are then
/// incomplete.
pub fn set_positions(
    positions: &[u32],
    frame: i64,
    mut packed: ArrayViewMut2<'_, u8>,
) -> Result<i64> {
    let bits = 8 * packed.ncols();
    let mut listed = Vec::new();
    let mut rest = positions;
    while let Some(length) = find(rest, bits) {
        listed.push(&rest[..length]);
        rest = &rest[length + 1..];
    }
    let next = frame.saturating_add(listed.len() as i64);
    listed.push(rest);
    let largest = listed.par_iter().map(|list| max(list)).max();
    if let Some(largest) = largest.filter(|&largest| largest as usize > bits) {
        let expected = format!("at most {bits}");
        return Err(Error::range("positions", expected, largest));
    }
    // The lists of the frames before `packed` are skipped, or the rows before the first list.
    let lists = usize::try_from(frame.saturating_neg())
        .unwrap_or_default()
        .min(listed.len());
    let rows = usize::try_from(frame)
        .unwrap_or_default()
        .min(packed.nrows());
    packed
        .slice_mut(s![rows.., ..])
        .axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(&listed[lists..])
        .for_each(|(row, list)| {
            if !interrupt::is_requested() {
                set(list, row);
            }
        });
    Ok(next)
}

/// Return the index of the first `wanted` number.
fn find(list: &[u32], wanted: usize) -> Option<usize> {
    // The compiler vectorizes the search in a whole chunk, because it does not end early.
    let is_wanted = |&number: &u32| number as usize == wanted;
    let mut chunks = list.chunks(NUMBERS_PER_CHUNK);
    let chunk = chunks.position(|chunk| chunk.iter().fold(false, |any, n| any | is_wanted(n)))?;
    let first = chunk * NUMBERS_PER_CHUNK;
    list[first..]
        .iter()
        .position(is_wanted)
        .map(|index| first + index)
}

fn max(list: &[u32]) -> u32 {
    list.iter().copied().fold(0, u32::max)
}

/// Set the bits at the positions of a list in the bytes of a row.
fn set(list: &[u32], mut row: ArrayViewMut1<'_, u8>) {
    if let Some(row) = row.as_slice_mut() {
        for &position in list {
            row[position as usize / 8] |= 0x80 >> (position % 8);
        }
    } else {
        for &position in list {
            row[position as usize / 8] |= 0x80 >> (position % 8);
        }
    }
}

levels! {
    /// Reverse the order of the bits of each byte.
    fn reverse(bytes: &mut [u8]) = reverse_inlined;
}

#[inline(always)]
fn reverse_inlined(bytes: &mut [u8]) {
    for byte in bytes {
        *byte = byte.reverse_bits();
    }
}

/// The transposition of one frame, whose rows have `row_bytes` bytes.
struct TransposeFrame<'a, 'b> {
    bytes: &'a [u8],
    row_bytes: usize,
    transposed: ArrayViewMut2<'b, u8>,
}

impl WithSimd for TransposeFrame<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        transpose_frame(self.bytes, self.row_bytes, self.transposed);
    }
}

#[inline(always)]
fn transpose_frame(bytes: &[u8], row_bytes: usize, mut transposed: ArrayViewMut2<'_, u8>) {
    let column_bytes = transposed.ncols();
    if column_bytes == 0 {
        return;
    }
    let groups = column_bytes.div_ceil(LANES * SIDE_BYTES);
    let mut columns = vec![[[0; SIDE_BYTES]; LANES]; SIDE * groups];
    for (band, mut targets) in transposed.axis_chunks_iter_mut(Axis(0), SIDE).enumerate() {
        for (group, rows) in bytes.chunks(LANES * SIDE * row_bytes).enumerate() {
            let mut words = [[0; LANES]; SIDE];
            for (lane, rows) in rows.chunks(SIDE * row_bytes).enumerate() {
                for (word, row) in words.iter_mut().zip(rows.chunks_exact(row_bytes)) {
                    // The first bit becomes the most significant.
                    word[lane] = u64::from_be_bytes(first_word(&row[band * SIDE_BYTES..]));
                }
            }
            transpose_squares(&mut words);
            for (columns, word) in columns.chunks_exact_mut(groups).zip(words) {
                columns[group] = word.map(u64::to_be_bytes);
            }
        }
        for (mut target, column) in targets.rows_mut().into_iter().zip(columns.chunks(groups)) {
            let column = &column.as_flattened().as_flattened()[..column_bytes];
            match target.as_slice_mut() {
                Some(target) => target.copy_from_slice(column),
                None => target.iter_mut().zip(column).for_each(|(a, &b)| *a = b),
            }
        }
    }
}

/// Transpose squares of bits. Each word is a row of one square.
///
/// Each step exchanges the upper right with the lower left quarter of smaller squares: Warren,
/// "Hacker's Delight", 2nd edition, section 7-3.
#[inline(always)]
fn transpose_squares(words: &mut [[u64; LANES]; SIDE]) {
    exchange::<32>(words, 0x0000_0000_ffff_ffff);
    exchange::<16>(words, 0x0000_ffff_0000_ffff);
    exchange::<8>(words, 0x00ff_00ff_00ff_00ff);
    exchange::<4>(words, 0x0f0f_0f0f_0f0f_0f0f);
    exchange::<2>(words, 0x3333_3333_3333_3333);
    exchange::<1>(words, 0x5555_5555_5555_5555);
}

#[inline(always)]
fn exchange<const QUARTER: usize>(words: &mut [[u64; LANES]; SIDE], right: u64) {
    for rows in words.chunks_exact_mut(2 * QUARTER) {
        let (upper, lower) = rows.split_at_mut(QUARTER);
        for (upper, lower) in upper.iter_mut().zip(lower) {
            for (upper, lower) in upper.iter_mut().zip(lower) {
                let differences = (*upper ^ *lower >> QUARTER) & right;
                *upper ^= differences;
                *lower ^= differences << QUARTER;
            }
        }
    }
}
