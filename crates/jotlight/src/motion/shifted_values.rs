//! Sums of values of the jots along a motion.

use std::ops::Range;

use ndarray::parallel::prelude::*;
use ndarray::{ArrayView3, ArrayViewMut2, ArrayViewMut3, Axis};

use super::field::Displacements;
use super::frames::{Piece, check_size, check_times};
use super::lines::BLOCK;
use super::row::RowMotion;
use super::source::Frame;
use crate::bits::contiguous;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

/// Add values of the jots `(m, H, W)` to the sums of the pixels that see them, `out` `(m, H, W)`.
///
/// `times` are those of the frames, as for [`super::count_shifted`]. In each frame, a pixel
/// sees the jot whose bit that function counts. Jots outside of the frame add 0.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match, or the displacements are those of an
/// image of another size. [`Error::Range`] if a time is not in \[-1, n\] for n fields, or a frame has
/// more than 2^24 rows or columns.
pub fn add_shifted_values(
    of_jots: ArrayView3<'_, f32>,
    motion: &Displacements<'_>,
    times: &[f64],
    mut out: ArrayViewMut3<'_, f32>,
) -> Result<()> {
    let (_, rows, columns) = of_jots.dim();
    check_size(rows, columns)?;
    motion.check_size((rows, columns))?;
    check_times(times, motion.number())?;
    if out.dim() != of_jots.dim() {
        return Err(Error::shape("output", of_jots.dim(), out.dim()));
    }
    if of_jots.is_empty() {
        return Ok(());
    }
    let (pieces, times) = Piece::divide(times, motion.number());
    let input = Input {
        of_jots,
        motion,
        pieces: &pieces,
        times: &times,
        frame: Frame { rows, columns },
    };
    out.axis_iter_mut(Axis(1))
        .into_par_iter()
        .enumerate()
        .for_each_init(
            || RowMotion::new(motion),
            |of_row, (row, mut out)| add_to_row(&input, row, of_row, &mut out),
        );
    Ok(())
}

/// The values, and how they move.
struct Input<'a> {
    of_jots: ArrayView3<'a, f32>,
    motion: &'a Displacements<'a>,
    pieces: &'a [Piece],
    /// The times of the frames in their pieces.
    times: &'a [f32],
    frame: Frame,
}

levels! {
    /// Add the values that the pixels of a row see to their sums, `(m, W)`.
    fn add_to_row(
        input: &Input<'_>, row: usize, of_row: &mut RowMotion<'_>, out: &mut ArrayViewMut2<'_, f32>,
    ) = add_to_row_inlined;
}

#[inline(always)]
fn add_to_row_inlined(
    input: &Input<'_>,
    row: usize,
    of_row: &mut RowMotion<'_>,
    out: &mut ArrayViewMut2<'_, f32>,
) {
    let columns = input.frame.columns;
    for piece in input.pieces {
        of_row.set(input.motion, piece.field, row);
        for &time in &input.times[piece.frames.clone()] {
            if interrupt::is_requested() {
                return;
            }
            if let Some(shift) = of_row.common_shift([time; 2]) {
                add_part(input, row, 0..columns, shift, out);
                continue;
            }
            for block in 0..columns.div_ceil(BLOCK) {
                let [along_rows, along_columns] =
                    of_row.block(block).map(|pixels| pixels.shifts(time));
                // Neighbors with equal shifts are added together.
                let (mut start, end) = (0, of_row.length(block));
                for next in 1..=end {
                    let shift = [along_rows[start], along_columns[start]];
                    if next < end && [along_rows[next], along_columns[next]] == shift {
                        continue;
                    }
                    let part = block * BLOCK + start..block * BLOCK + next;
                    add_part(input, row, part, shift, out);
                    start = next;
                }
            }
        }
    }
}

/// Add the values that some pixels of a row with the same shift see.
#[inline(always)]
fn add_part(
    input: &Input<'_>,
    row: usize,
    pixels: Range<usize>,
    shift: [i32; 2],
    out: &mut ArrayViewMut2<'_, f32>,
) {
    let inside = input.frame.columns_inside(row, shift);
    let (start, end) = (inside.start.max(pixels.start), inside.end.min(pixels.end));
    if start >= end {
        return;
    }
    let source_row = row.saturating_add_signed(shift[0] as isize);
    let first = start.saturating_add_signed(shift[1] as isize);
    for (of_jots, mut out) in input.of_jots.outer_iter().zip(out.rows_mut()) {
        let source = contiguous(of_jots.row(source_row));
        let source = &source[first..][..end - start];
        match out.as_slice_mut() {
            Some(out) => add(source, &mut out[start..end]),
            None => {
                for (index, value) in source.iter().enumerate() {
                    out[start + index] += value;
                }
            }
        }
    }
}

#[inline(always)]
fn add(source: &[f32], out: &mut [f32]) {
    for (out, value) in out.iter_mut().zip(source) {
        *out += value;
    }
}
