//! Random bits b = [Y ≥ q], drawn directly into packed words (paper, equation (3)).

use ndarray::{ArrayViewMut1, ArrayViewMut3, Axis};
use rayon::prelude::*;

use super::exposure::Exposure;
use super::probability_table::ProbabilityTable;
use super::row_sampler::RowSampler;
use super::{Image, JOTS_PER_SEGMENT, Sensor, Window};
use crate::bits::packed_width;
use crate::error::{Error, Result};
use crate::interrupt;
use crate::rng::RowStream;

/// The minimum number of jots per task. Drawing them takes much longer than starting the task.
const MIN_JOTS_PER_TASK: usize = 1 << 15;

/// Draw the bits of a window of frames and pixels into `out` `(frames, rows·K̂, ⌈columns·K̂ / 8⌉)`.
///
/// The bits are packed with the most significant bit first. Each jot has its own position in the
/// random streams. Therefore the bits of a jot do not depend on the window, and the bits of
/// different color channels are independent. `channel` is the index of the color channel.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the window
/// exceeds the image, if a parameter of the sensor or an intensity is infinite, NaN, or negative, or
/// if there are too many frames, rows, or channels for the random streams.
pub fn expose(
    sensor: &Sensor<'_>,
    image: Image<'_>,
    seed: [u8; 32],
    channel: usize,
    window: &Window,
    mut out: ArrayViewMut3<'_, u8>,
) -> Result<()> {
    let (rows, columns) = sensor.check_draw(&image, channel, window)?;
    let expected = (window.frames.len(), rows.len(), packed_width(columns.len()));
    if out.dim() != expected {
        return Err(Error::shape("out", expected, out.dim()));
    }
    if out.is_empty() {
        return Ok(());
    }
    let exposure = Exposure { sensor, image };
    let table = ProbabilityTable::shared(sensor.threshold);
    let jots_per_row = out.len() / window.rows.len() * 8;
    // A task draws whole rows of pixels in all frames, so each probability is computed only once.
    out.axis_chunks_iter_mut(Axis(1), sensor.kernel.oversampling())
        .into_par_iter()
        .enumerate()
        .with_min_len((MIN_JOTS_PER_TASK / jots_per_row).max(1))
        .for_each_init(
            || RowSampler::new(seed, &table),
            |sampler, (row, mut out)| {
                let row = window.rows.start + row;
                draw_pixel_row(sampler, &exposure, row, channel, window, &mut out);
            },
        );
    Ok(())
}

/// Draw a row of pixels in all frames of the window. It consists of K̂ rows of jots.
fn draw_pixel_row(
    sampler: &mut RowSampler<'_>,
    exposure: &Exposure<'_, '_, '_>,
    pixel_row: usize,
    channel: usize,
    window: &Window,
    out: &mut ArrayViewMut3<'_, u8>,
) {
    let oversampling = exposure.sensor.kernel.oversampling();
    let end = window.columns.end * oversampling;
    let first = window.columns.start * oversampling;
    for start in (first..end).step_by(JOTS_PER_SEGMENT) {
        let columns = start..(start + JOTS_PER_SEGMENT).min(end);
        for jot_row in 0..oversampling {
            let row = pixel_row * oversampling + jot_row;
            if jot_row == 0 || !exposure.sensor.has_uniform_pixels() {
                sampler.select(exposure, row, columns.clone());
            }
            let mut out = out.index_axis_mut(Axis(1), jot_row);
            for (frame, mut out) in window.frames.clone().zip(out.outer_iter_mut()) {
                if interrupt::is_requested() {
                    return;
                }
                let stream = RowStream::new(channel, frame, row);
                let (words, offset) = sampler.draw(stream, &exposure.sensor.threshold);
                let byte = (start - first) / 8;
                write_bits(words, offset, columns.len(), byte, &mut out);
            }
        }
    }
}

/// Write `length` bits of `words`, starting at bit `offset`, to `out`, starting at byte `byte`.
///
/// The padding bits of the last byte are 0.
fn write_bits(
    words: &[u64],
    offset: usize,
    length: usize,
    byte: usize,
    out: &mut ArrayViewMut1<'_, u8>,
) {
    let (words, shift) = (&words[offset / 64..], offset % 64);
    let word = |index: usize| {
        let next = words.get(index + 1).copied().unwrap_or_default();
        let both = u128::from(words[index]) << 64 | u128::from(next);
        (both >> (64 - shift)) as u64
    };
    let whole_words = length / 64;
    if let Some(out) = out.as_slice_mut() {
        let out = out[byte..].as_chunks_mut::<8>().0;
        for (index, out) in out.iter_mut().take(whole_words).enumerate() {
            *out = word(index).to_be_bytes();
        }
    } else {
        let bytes = (0..whole_words).flat_map(|index| word(index).to_be_bytes());
        for (out, value) in out.iter_mut().skip(byte).zip(bytes) {
            *out = value;
        }
    }
    let remaining = length % 64;
    if remaining > 0 {
        let last = word(whole_words) & !(u64::MAX >> remaining);
        let rest = out.iter_mut().skip(byte + 8 * whole_words);
        for (out, value) in rest.zip(last.to_be_bytes()).take(remaining.div_ceil(8)) {
            *out = value;
        }
    }
}
