//! Estimates that depend on the count of a pixel alone, from a table with one value for each count.

use ndarray::{ArrayViewMut2, Axis};
use rayon::prelude::*;

use crate::bits::{PackedBits, count_region, trials};
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;

use super::PIXELS_PER_CHUNK;

/// The number of bytes of a frame that a task counts. The counts of its pixels stay in the cache.
const BYTES_PER_TASK: usize = 1 << 13;

/// Write the value of the number of ones of each pixel into `out`: `table[L]`.
///
/// It takes little longer than counting, because the counts need no memory of their own.
///
/// # Errors
/// [`Error::Shape`] if the shapes do not match, or the table does not have a value for each count
/// from 0 to K. [`Error::Range`] if the oversampling is 0 or does not divide the height and the
/// width, or K exceeds the `i32`.
pub fn look_up_counts(
    bits: &PackedBits<'_>,
    oversampling: usize,
    table: &[f32],
    mut out: ArrayViewMut2<'_, f32>,
) -> Result<()> {
    let (height, width) = bits.pixel_shape(oversampling)?;
    if out.dim() != (height, width) {
        return Err(Error::shape("out", (height, width), out.dim()));
    }
    let (frames, _, jots) = bits.shape();
    let expected = trials(frames, oversampling)? as usize + 1;
    if table.len() != expected {
        return Err(Error::shape("table", expected, table.len()));
    }
    let rows = (BYTES_PER_TASK / jots.div_ceil(8).max(1) / oversampling).max(1);
    out.axis_chunks_iter_mut(Axis(0), rows)
        .into_par_iter()
        .enumerate()
        .for_each(|(chunk, mut out)| {
            if interrupt::is_requested() {
                return;
            }
            let first = chunk * rows;
            let (counts, _) =
                count_region(bits, oversampling, first..first + out.nrows(), 0..width);
            for (mut out, counts) in out.rows_mut().into_iter().zip(counts.rows()) {
                if let (Some(out), Some(counts)) = (out.as_slice_mut(), counts.as_slice()) {
                    look_up(table, counts, out, &mut 0);
                } else {
                    for (out, &ones) in out.iter_mut().zip(counts) {
                        *out = table[ones as usize];
                    }
                }
            }
        });
    Ok(())
}

/// Write the value of each count into `out`, and return the largest count as an unsigned number, so a
/// negative one is large. Values of counts without a value have no meaning.
pub(super) fn look_up_all(table: &[f32], counts: &[i32], out: &mut [f32]) -> u32 {
    let chunks = out.par_chunks_mut(PIXELS_PER_CHUNK);
    let largest = chunks
        .zip(counts.par_chunks(PIXELS_PER_CHUNK))
        .map(|(out, counts)| {
            let mut largest = 0;
            if !interrupt::is_requested() {
                look_up(table, counts, out, &mut largest);
            }
            largest
        });
    largest.max().unwrap_or(0)
}

levels! {
    /// Write the value of each count, an index into the table, into `out`. `largest` becomes the
    /// largest count as an unsigned number, so a negative one is large.
    fn look_up(
        table: &[f32], counts: &[i32], out: &mut [f32], largest: &mut u32,
    ) = look_up_inlined;
}

#[inline(always)]
fn look_up_inlined(table: &[f32], counts: &[i32], out: &mut [f32], largest: &mut u32) {
    let Some(last) = table.len().checked_sub(1) else {
        return;
    };
    for (out, &ones) in out.iter_mut().zip(counts) {
        let ones = ones as u32;
        *largest = (*largest).max(ones);
        // The minimum replaces a branch for each pixel.
        *out = table[(ones as usize).min(last)];
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3};

    use super::*;
    use crate::bits::add_block_counts;

    #[test]
    fn values_are_those_of_the_counts() -> Result<()> {
        for (frames, height, jots, oversampling) in [(3, 4, 8, 1), (40, 600, 24, 2), (17, 6, 9, 3)]
        {
            let shape = (frames, height, usize::div_ceil(jots, 8));
            let mut packed = Array3::from_shape_fn(shape, |(frame, row, byte)| {
                (frame * 31 + row * 17 + byte * 101 + frame * row) as u8
            });
            // The bits after the last column are 0.
            let unused = 8 * shape.2 - jots;
            for last in packed.index_axis_mut(Axis(2), shape.2 - 1) {
                *last = *last >> unused << unused;
            }
            let bits = PackedBits::new(packed.view(), jots)?;
            let (rows, columns) = bits.pixel_shape(oversampling)?;
            let mut counts = Array2::zeros((rows, columns));
            add_block_counts(&bits, oversampling, None, counts.view_mut())?;
            let table: Vec<f32> = (0..=frames * oversampling * oversampling)
                .map(|ones| (ones as f32).sqrt())
                .collect();
            let mut out = Array2::zeros((rows, columns));
            look_up_counts(&bits, oversampling, &table, out.view_mut())?;
            assert_eq!(out, counts.mapv(|ones: i32| (ones as f32).sqrt()));
            let mut other = Array2::zeros((columns, rows));
            look_up_counts(
                &bits,
                oversampling,
                &table,
                other.view_mut().reversed_axes(),
            )?;
            assert_eq!(other.t(), out);
            let short = look_up_counts(&bits, oversampling, &table[1..], out.view_mut());
            assert!(matches!(short, Err(Error::Shape { .. })));
        }
        Ok(())
    }
}
