//! Counts L of the ones of each pixel, without unpacking the bits.

use std::borrow::Cow;
use std::ops::Range;

use ndarray::{
    Array2, ArrayView1, ArrayView2, ArrayViewMut1, ArrayViewMut2, ArrayViewMut3, Axis, s,
};
use num_integer::gcd;
use rayon::prelude::*;

use super::bit_planes::{BitCounters, FRAMES_PER_GROUP};
use super::{MAX_FIELD_BITS, PackedBits, bit_field, contiguous, mask_row, packed_width};
use crate::cpu::levels;
use crate::error::{Error, Result, check_shape};
use crate::images::for_each_image;
use crate::interrupt;

/// The minimum and the maximum number of bytes per frame that one task counts with bit planes.
///
/// Long sequences are read fastest, but the bit planes must fit into the cache. Tasks are smaller
/// than the maximum if larger ones would leave threads without work.
const BYTES_PER_BIT_PLANE_TASK: std::ops::RangeInclusive<usize> = 1024..=8192;

/// The number of bytes per frame that one task counts frame by frame. Counting them takes much
/// longer than starting the task.
const BYTES_PER_FRAME_TASK: usize = 1 << 14;

/// The minimum number of frames for which bit planes are faster than counting frame by frame.
const MIN_FRAMES_FOR_BIT_PLANES: usize = 2 * FRAMES_PER_GROUP;

/// Add the number of ones of each pixel, over its K̂ × K̂ jots and all frames, to `counts`.
///
/// `valid` is a packed mask `(H, ⌈W/8⌉)`. Jots whose bit in the mask is 0 are not counted.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the oversampling
/// K̂ is 0 or does not divide the height and the width, or if a count could exceed the `i32`. After
/// the latter error, the counts are incomplete.
pub fn add_block_counts(
    bits: &PackedBits<'_>,
    oversampling: usize,
    valid: Option<ArrayView2<'_, u8>>,
    mut counts: ArrayViewMut2<'_, i32>,
) -> Result<()> {
    let pixels = bits.pixel_shape(oversampling)?;
    if counts.dim() != pixels {
        return Err(Error::shape("counts", pixels, counts.dim()));
    }
    let (frames, rows, width) = bits.shape();
    check_mask(valid, rows, width)?;
    if counts.is_empty() {
        return Ok(());
    }
    let trials = trials(frames, oversampling)?;
    let use_bit_planes = oversampling == 1 || frames >= MIN_FRAMES_FOR_BIT_PLANES;
    let bytes_per_task = if use_bit_planes {
        let bytes_per_thread = packed_width(width) * rows / rayon::current_num_threads();
        let limits = BYTES_PER_BIT_PLANE_TASK;
        bytes_per_thread.clamp(*limits.start(), *limits.end())
    } else {
        BYTES_PER_FRAME_TASK
    };
    let jot_rows = (bytes_per_task / packed_width(width)).max(1);
    let pixel_rows = (jot_rows / oversampling).max(1);
    counts
        .axis_chunks_iter_mut(Axis(0), pixel_rows)
        .into_par_iter()
        .enumerate()
        .try_for_each(|(chunk, mut counts)| {
            check_sum(trials, counts.view())?;
            let first = chunk * pixel_rows * oversampling;
            if use_bit_planes {
                // One row of pixels may have more bytes than a task should count.
                for row in (0..counts.nrows() * oversampling).step_by(jot_rows) {
                    let rows = row..(row + jot_rows).min(counts.nrows() * oversampling);
                    add_with_bit_planes(bits, oversampling, first, rows, valid, &mut counts);
                }
            } else {
                add_frame_by_frame(bits, frames, oversampling, first, valid, counts);
            }
            Ok(())
        })
}

/// Add the ones of each of several images to `counts` `(N, H, W)`, as [`add_block_counts`] does. All
/// images have the same mask.
///
/// # Errors
/// [`Error::Shape`] if there are not N images, and the errors of [`add_block_counts`].
pub fn add_block_counts_of_images(
    images: &[PackedBits<'_>],
    oversampling: usize,
    valid: Option<ArrayView2<'_, u8>>,
    mut counts: ArrayViewMut3<'_, i32>,
) -> Result<()> {
    check_shape("images", counts.dim().0, images.len())?;
    for_each_image(
        images.iter().zip(counts.outer_iter_mut()),
        |(bits, counts)| add_block_counts(bits, oversampling, valid, counts),
    )
}

/// Return the number of ones of each pixel in a region of rows and columns of pixels, and the number
/// of columns that precede the region in the result.
///
/// The oversampling must divide the height and the width of the bits, and K must fit into `i32`.
pub(crate) fn count_region(
    bits: &PackedBits<'_>,
    oversampling: usize,
    rows: Range<usize>,
    columns: Range<usize>,
) -> (Array2<i32>, usize) {
    // The counted columns begin with a whole byte.
    let pixels = 8 / gcd(8, oversampling);
    let start = columns.start / pixels * pixels;
    let part = bits.columns(start * oversampling..columns.end * oversampling);
    let mut counts = Array2::zeros((rows.len(), columns.end - start));
    let first = rows.start * oversampling;
    let frames = part.shape().0;
    if oversampling == 1 || frames >= MIN_FRAMES_FOR_BIT_PLANES {
        let jot_rows = 0..counts.nrows() * oversampling;
        let (none, mut view) = (None, counts.view_mut());
        add_with_bit_planes(&part, oversampling, first, jot_rows, none, &mut view);
    } else {
        add_frame_by_frame(&part, frames, oversampling, first, None, counts.view_mut());
    }
    (counts, columns.start - start)
}

/// Return K = T·K̂², the number of bits of a pixel.
///
/// # Errors
/// [`Error::Range`] if K exceeds the `i32`.
pub(crate) fn trials(frames: usize, oversampling: usize) -> Result<i32> {
    let jots = oversampling.checked_mul(oversampling);
    jots.and_then(|jots| i32::try_from(jots.checked_mul(frames)?).ok())
        .ok_or_else(|| {
            let received = format!("{frames} frames and an oversampling of {oversampling}");
            Error::range("trials per pixel", "less than 2^31", received)
        })
}

/// Check that counts cannot overflow if they increase by up to `increase`.
fn check_sum(increase: i32, counts: ArrayView2<'_, i32>) -> Result<()> {
    let mut max = 0;
    for row in counts.rows() {
        include_max(&contiguous(row), &mut max);
    }
    match max.checked_add(increase) {
        Some(_) => Ok(()),
        None => Err(Error::range(
            "counts",
            "sums of less than 2^31",
            format!("a count of {max} and {increase} more bits"),
        )),
    }
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

/// Add the ones of few frames to `counts`. Its first row of jots is the row `first`.
fn add_frame_by_frame(
    bits: &PackedBits<'_>,
    frames: usize,
    oversampling: usize,
    first: usize,
    valid: Option<ArrayView2<'_, u8>>,
    mut counts: ArrayViewMut2<'_, i32>,
) {
    let rows = first..first + counts.nrows() * oversampling;
    for frame in 0..frames {
        if interrupt::is_requested() {
            return;
        }
        let mut bytes = bits.rows(frame, rows.clone());
        if let Some(valid) = valid {
            let valid = valid.slice_move(s![rows.clone(), ..]);
            for (bits, valid) in bytes.to_mut().iter_mut().zip(valid) {
                *bits &= valid;
            }
        }
        add_rows(&bytes, oversampling, &mut counts);
    }
}

levels! {
    /// Replace `max` with the maximum of `max` and all counts.
    fn include_max(counts: &[i32], max: &mut i32) = include_max_inlined;
    /// Add the ones of each pixel in consecutive rows of jots.
    fn add_rows(
        bytes: &[u8], oversampling: usize, counts: &mut ArrayViewMut2<'_, i32>,
    ) = add_rows_inlined;
    /// Add the counts of each pair of jots.
    fn add_pairs(jots: &[i32], counts: &mut [i32]) = add_pairs_inlined;
}

#[inline(always)]
fn add_pairs_inlined(jots: &[i32], counts: &mut [i32]) {
    for (count, [left, right]) in counts.iter_mut().zip(jots.as_chunks().0) {
        *count += left + right;
    }
}

#[inline(always)]
fn include_max_inlined(counts: &[i32], max: &mut i32) {
    *max = counts.iter().copied().fold(*max, i32::max);
}

#[inline(always)]
fn add_rows_inlined(bytes: &[u8], oversampling: usize, counts: &mut ArrayViewMut2<'_, i32>) {
    let width = packed_width(oversampling * counts.ncols());
    for (row, bytes) in bytes.chunks_exact(width.max(1)).enumerate() {
        add_row(bytes, oversampling, &mut counts.row_mut(row / oversampling));
    }
}

#[inline(always)]
fn add_row(bytes: &[u8], oversampling: usize, counts: &mut ArrayViewMut1<'_, i32>) {
    if let (2 | 4 | 8, Some(counts)) = (oversampling, counts.as_slice_mut()) {
        return match oversampling {
            2 => add_pixels_of_bytes::<4>(bytes, counts),
            4 => add_pixels_of_bytes::<2>(bytes, counts),
            _ => add_pixels_of_bytes::<1>(bytes, counts),
        };
    }
    if oversampling <= MAX_FIELD_BITS {
        for (pixel, count) in counts.iter_mut().enumerate() {
            *count += bit_field(bytes, pixel * oversampling, oversampling).count_ones() as i32;
        }
        return;
    }
    for (pixel, count) in counts.iter_mut().enumerate() {
        let mut start = pixel * oversampling;
        let end = start + oversampling;
        while start < end {
            let length = (end - start).min(MAX_FIELD_BITS);
            *count += bit_field(bytes, start, length).count_ones() as i32;
            start += length;
        }
    }
}

/// Add the ones of a row of pixels. The pixels are 2, 4, or 8 jots wide, so `PIXELS` of them fill
/// one byte.
#[inline(always)]
fn add_pixels_of_bytes<const PIXELS: usize>(bytes: &[u8], counts: &mut [i32]) {
    let width = 8 / PIXELS;
    let count_ones = |byte: u8, pixel: usize| {
        // The sums of groups of two bits, then of four, then of eight. The byte holds all groups.
        let mut sums = byte - (byte >> 1 & 0x55);
        if PIXELS < 4 {
            sums = (sums & 0x33) + (sums >> 2 & 0x33);
        }
        if PIXELS < 2 {
            sums = (sums & 0x0f) + (sums >> 4);
        }
        i32::from(sums >> (8 - width * (pixel + 1)) & (0xff >> (8 - width)) as u8)
    };
    let (groups, rest) = counts.as_chunks_mut::<PIXELS>();
    let whole_bytes = groups.len();
    for (counts, &byte) in groups.iter_mut().zip(bytes) {
        for pixel in 0..PIXELS {
            counts[pixel] += count_ones(byte, pixel);
        }
    }
    for (pixel, count) in rest.iter_mut().enumerate() {
        *count += count_ones(bytes[whole_bytes], pixel);
    }
}

/// Add the ones of many frames to `counts`, but only those of a range of its rows of jots.
///
/// The first row of jots of `counts` is the row `first` of the bits. Bit planes first count the
/// ones of each jot over the frames. Then the counts of the jots of each pixel are added.
fn add_with_bit_planes(
    bits: &PackedBits<'_>,
    oversampling: usize,
    first: usize,
    rows: Range<usize>,
    valid: Option<ArrayView2<'_, u8>>,
    counts: &mut ArrayViewMut2<'_, i32>,
) {
    let (frames, _, columns) = bits.shape();
    let width = packed_width(columns);
    let rows_of_bits = first + rows.start..first + rows.end;
    let mut counters = BitCounters::new(rows.len() * width);
    let no_ones = vec![0; rows.len() * width];
    for group in (0..frames).step_by(FRAMES_PER_GROUP) {
        if interrupt::is_requested() {
            return;
        }
        let sequences: [Cow<'_, [u8]>; FRAMES_PER_GROUP] = std::array::from_fn(|index| {
            if group + index < frames {
                bits.rows(group + index, rows_of_bits.clone())
            } else {
                Cow::Borrowed(&no_ones[..])
            }
        });
        counters.add(&sequences.each_ref().map(|bytes| &bytes[..]));
    }
    let mut jots = vec![0; columns];
    for (index, row) in rows.enumerate() {
        jots.fill(0);
        counters.add_to_counts(index * width..(index + 1) * width, &mut jots);
        if let Some(valid) = valid {
            let valid = mask_row(valid, first + row);
            for (column, jot) in jots.iter_mut().enumerate() {
                *jot *= i32::from(valid[column / 8] >> (7 - column % 8) & 1);
            }
        }
        let mut counts = counts.row_mut(row / oversampling);
        if oversampling == 1 {
            // The compiler vectorizes this addition.
            counts += &ArrayView1::from(&jots);
            continue;
        }
        if let (2, Some(counts)) = (oversampling, counts.as_slice_mut()) {
            add_pairs(&jots, counts);
            continue;
        }
        for (count, jots) in counts.iter_mut().zip(jots.chunks_exact(oversampling)) {
            *count += jots.iter().sum::<i32>();
        }
    }
}
