//! Ones per pixel, counted in the packed domain.

use std::borrow::Cow;

use ndarray::{ArrayView2, ArrayViewMut1, ArrayViewMut2, Axis, s};
use rayon::prelude::*;

use super::planes::{GROUP, Planes};
use super::{FIELD, PackedBits, field, mask_row, packed_width};
use crate::cpu::levels;
use crate::error::{Error, Result};

/// Bytes of a frame that one task counts in all frames: as many as can be, since memory is read fastest in long stretches, but so few that
/// the planes stay near the core, and fewer where that leaves threads without work.
const STRETCH: std::ops::RangeInclusive<usize> = 1024..=8192;

/// Bytes of a frame that make it worth while to start a task.
const TASK: usize = 1 << 14;

/// With so many frames bit planes are faster than counting the bits of each pixel in each frame.
const MANY: usize = 2 * GROUP;

/// Adds, to each pixel of `counts`, the ones among its `side` × `side` jots in all frames. `valid` is a packed mask of the
/// jots that count, `(H, ⌈W/8⌉)`.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn add_block_counts(
    bits: &PackedBits<'_>,
    side: usize,
    valid: Option<ArrayView2<'_, u8>>,
    mut counts: ArrayViewMut2<'_, i32>,
) -> Result<()> {
    let pixels = bits.pixels(side)?;
    if counts.dim() != pixels {
        return Err(Error::shape("counts", pixels, counts.dim()));
    }
    let (frames, rows, width) = bits.shape();
    check_mask(valid, rows, width)?;
    let in_planes = side == 1 || frames >= MANY;
    let share = packed_width(width) * rows / rayon::current_num_threads();
    let stretch = if in_planes {
        share.clamp(*STRETCH.start(), *STRETCH.end())
    } else {
        TASK
    };
    let lines = (stretch / (packed_width(width) * side).max(1)).max(1);
    counts
        .axis_chunks_iter_mut(Axis(0), lines)
        .into_par_iter()
        .enumerate()
        .for_each(|(chunk, counts)| {
            let first = chunk * lines;
            if in_planes {
                add_in_planes(bits, frames, side, first, valid, counts);
            } else {
                add_blocks(bits, frames, side, first, valid, counts);
            }
        });
    Ok(())
}

pub(crate) fn check_mask(
    valid: Option<ArrayView2<'_, u8>>,
    rows: usize,
    width: usize,
) -> Result<()> {
    match valid {
        Some(valid) if valid.dim() != (rows, packed_width(width)) => Err(Error::shape(
            "packed mask",
            (rows, packed_width(width)),
            valid.dim(),
        )),
        _ => Ok(()),
    }
}

fn add_blocks(
    bits: &PackedBits<'_>,
    frames: usize,
    side: usize,
    first: usize,
    valid: Option<ArrayView2<'_, u8>>,
    mut counts: ArrayViewMut2<'_, i32>,
) {
    let rows = first * side..(first + counts.nrows()) * side;
    for frame in 0..frames {
        let mut bytes = bits.rows(frame, rows.clone());
        if let Some(valid) = valid {
            let valid = valid.slice_move(s![rows.clone(), ..]);
            for (bits, valid) in bytes.to_mut().iter_mut().zip(valid) {
                *bits &= valid;
            }
        }
        add_rows(&bytes, side, &mut counts);
    }
}

levels! {
    /// Adds the ones of each pixel in rows of jots.
    fn add_rows(bytes: &[u8], side: usize, counts: &mut ArrayViewMut2<'_, i32>) = add_rows_inlined;
}

#[inline(always)]
fn add_rows_inlined(bytes: &[u8], side: usize, counts: &mut ArrayViewMut2<'_, i32>) {
    let width = packed_width(side * counts.ncols());
    for (row, bytes) in bytes.chunks_exact(width.max(1)).enumerate() {
        add_row(bytes, side, &mut counts.row_mut(row / side));
    }
}

#[inline(always)]
fn add_row(bytes: &[u8], side: usize, counts: &mut ArrayViewMut1<'_, i32>) {
    if let (2 | 4 | 8, Some(counts)) = (side, counts.as_slice_mut()) {
        return match side {
            2 => add_shares_of_bytes::<4>(bytes, counts),
            4 => add_shares_of_bytes::<2>(bytes, counts),
            _ => add_shares_of_bytes::<1>(bytes, counts),
        };
    }
    if side <= FIELD {
        for (pixel, count) in counts.iter_mut().enumerate() {
            *count += field(bytes, pixel * side, side).count_ones() as i32;
        }
        return;
    }
    for (pixel, count) in counts.iter_mut().enumerate() {
        let mut start = pixel * side;
        let end = start + side;
        while start < end {
            let length = (end - start).min(FIELD);
            *count += field(bytes, start, length).count_ones() as i32;
            start += length;
        }
    }
}

/// Adds the ones of pixels of 2, 4 or 8 jots, of which so many share a byte.
#[inline(always)]
fn add_shares_of_bytes<const PIXELS: usize>(bytes: &[u8], counts: &mut [i32]) {
    let width = 8 / PIXELS;
    let share = |byte: u8, pixel: usize| {
        // Sums of two, four and eight neighbouring bits, all of a byte at once.
        let mut sums = byte - (byte >> 1 & 0x55);
        if PIXELS < 4 {
            sums = (sums & 0x33) + (sums >> 2 & 0x33);
        }
        if PIXELS < 2 {
            sums = (sums & 0x0f) + (sums >> 4);
        }
        i32::from(sums >> (8 - width * (pixel + 1)) & (0xff >> (8 - width)) as u8)
    };
    let whole = counts.as_chunks_mut::<PIXELS>();
    for (counts, &byte) in whole.0.iter_mut().zip(bytes) {
        for pixel in 0..PIXELS {
            counts[pixel] += share(byte, pixel);
        }
    }
    for (pixel, count) in whole.1.iter_mut().enumerate() {
        *count += share(bytes[whole.0.len()], pixel);
    }
}

/// Many frames: the ones of each jot over all of them, in bit planes, then those of each pixel.
fn add_in_planes(
    bits: &PackedBits<'_>,
    frames: usize,
    side: usize,
    first: usize,
    valid: Option<ArrayView2<'_, u8>>,
    mut counts: ArrayViewMut2<'_, i32>,
) {
    let (_, _, columns) = bits.shape();
    let width = packed_width(columns);
    let rows = first * side..(first + counts.nrows()) * side;
    let mut planes = Planes::new(rows.len() * width);
    let nothing = vec![0; rows.len() * width];
    for group in (0..frames).step_by(GROUP) {
        let stretches: [Cow<'_, [u8]>; GROUP] = std::array::from_fn(|index| {
            if group + index < frames {
                bits.rows(group + index, rows.clone())
            } else {
                Cow::Borrowed(&nothing[..])
            }
        });
        planes.add(&stretches.each_ref().map(|bytes| &bytes[..]));
    }
    let mut jots = vec![0; columns];
    for row in 0..rows.len() {
        jots.fill(0);
        planes.add_to(row * width..(row + 1) * width, &mut jots);
        if let Some(valid) = valid {
            let valid = mask_row(valid, rows.start + row);
            for (column, jot) in jots.iter_mut().enumerate() {
                *jot *= i32::from(valid[column / 8] >> (7 - column % 8) & 1);
            }
        }
        let mut counts = counts.row_mut(row / side);
        for (count, jots) in counts.iter_mut().zip(jots.chunks_exact(side)) {
            *count += jots.iter().sum::<i32>();
        }
    }
}
