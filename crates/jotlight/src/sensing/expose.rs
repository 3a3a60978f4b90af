//! Random bits b = [Y ≥ q], drawn directly into packed words (paper, equation (3)).

use ndarray::{ArrayViewMut1, ArrayViewMut3, Axis};
use num_integer::{Integer, div_rem};
use rayon::prelude::*;

use super::probability_table::{ProbabilityTable, exact_probability};
use super::rate::Exposure;
use super::{Image, Sensor, Window};
use crate::bits::packed_width;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::interrupt;
use crate::likelihood::Threshold;
use crate::rng::{ALIGNMENT, JotRandom, RowStream, check_size};

/// The number of jots of a row that are drawn together. It bounds the memory of a thread.
const JOTS_PER_SEGMENT: usize = 2048;

/// The minimum number of jots per task. Drawing them takes much longer than starting the task.
const MIN_JOTS_PER_TASK: usize = 1 << 13;

/// Draw the bits of a window of frames and pixels into `out` `(frames, rows·K̂, ⌈columns·K̂ / 8⌉)`.
///
/// The bits are packed with the most significant bit first. Each jot has its own position in the
/// random streams. Therefore the bits of a jot do not depend on the window, and the bits of
/// different color channels are independent. `channel` is the index of the color channel.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the window
/// exceeds the image, or if there are too many frames, rows, or channels for the random streams.
pub fn expose(
    sensor: &Sensor<'_>,
    image: Image<'_>,
    seed: [u8; 32],
    channel: usize,
    window: &Window,
    mut out: ArrayViewMut3<'_, u8>,
) -> Result<()> {
    sensor.check(&image)?;
    window.check(image.shape())?;
    let oversampling = sensor.kernel.oversampling();
    check_size(channel, window.frames.end, sensor.jots(&image)?.0)?;
    let expected = (
        window.frames.len(),
        window.rows.len() * oversampling,
        packed_width(window.columns.len() * oversampling),
    );
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
    out.axis_chunks_iter_mut(Axis(1), oversampling)
        .into_par_iter()
        .enumerate()
        .with_min_len((MIN_JOTS_PER_TASK / jots_per_row).max(1))
        .for_each_init(
            || RowSampler::new(seed, &table),
            |sampler, (row, mut out)| {
                let row = window.rows.start + row;
                sampler.draw_pixel_row(&exposure, row, channel, window, &mut out);
            },
        );
    Ok(())
}

/// The random numbers and the buffers of a thread, which draws rows in segments.
struct RowSampler<'t> {
    random: JotRandom,
    table: &'t ProbabilityTable,
    /// The column of the first jot of the segment, a multiple of [`ALIGNMENT`].
    first_column: usize,
    /// The rates η s + d. Each belongs to `jots_per_rate` consecutive jots.
    rates: Vec<f64>,
    /// K̂ if all jots of a pixel have the same rate, and else 1.
    jots_per_rate: usize,
    /// P(b = 1) of each rate, in units of 2⁻¹⁶.
    rate_probabilities: Vec<u16>,
    /// P(b = 1) of each jot, in units of 2⁻¹⁶, padded to whole words.
    jot_probabilities: Vec<u16>,
    /// The 16-bit draws of the segment.
    draws: Vec<u8>,
    /// The bits of the segment.
    words: Vec<u64>,
    /// For each word, whether 16 bits do not decide one of its draws.
    undecided: Vec<bool>,
}

impl<'t> RowSampler<'t> {
    fn new(seed: [u8; 32], table: &'t ProbabilityTable) -> Self {
        Self {
            random: JotRandom::new(seed),
            table,
            first_column: 0,
            rates: Vec::new(),
            jots_per_rate: 1,
            rate_probabilities: Vec::new(),
            jot_probabilities: Vec::new(),
            draws: Vec::new(),
            words: Vec::new(),
            undecided: Vec::new(),
        }
    }

    /// Draw a row of pixels in all frames of the window. It consists of K̂ rows of jots.
    fn draw_pixel_row(
        &mut self,
        exposure: &Exposure<'_, '_, '_>,
        pixel_row: usize,
        channel: usize,
        window: &Window,
        out: &mut ArrayViewMut3<'_, u8>,
    ) {
        let oversampling = exposure.sensor.kernel.oversampling();
        let end = window.columns.end * oversampling;
        let mut start = window.columns.start * oversampling;
        let mut byte = 0;
        while start < end {
            let stop = (start + JOTS_PER_SEGMENT).min(end);
            // The draws start at an aligned column. The bits before `start` belong to jots outside
            // the segment and are not written.
            self.first_column = start.prev_multiple_of(&ALIGNMENT);
            for jot_row in 0..oversampling {
                let row = pixel_row * oversampling + jot_row;
                if jot_row == 0 || exposure.sensor.uniform_response().is_none() {
                    self.compute_rates(exposure, row, stop);
                    self.look_up_probabilities(stop);
                }
                let mut out = out.index_axis_mut(Axis(1), jot_row);
                for (frame, mut out) in window.frames.clone().zip(out.outer_iter_mut()) {
                    if interrupt::is_requested() {
                        return;
                    }
                    let stream = RowStream::new(channel, frame, row);
                    self.draw_words(stream, &exposure.sensor.threshold);
                    let offset = start - self.first_column;
                    write_bits(&self.words, offset, stop - start, byte, &mut out);
                }
            }
            byte += JOTS_PER_SEGMENT / 8;
            start = stop;
        }
    }

    /// Compute the rates of the jots of a row from `first_column` to `stop`.
    fn compute_rates(&mut self, exposure: &Exposure<'_, '_, '_>, row: usize, stop: usize) {
        let sensor = exposure.sensor;
        if let Some(response) = sensor.uniform_response() {
            let oversampling = sensor.kernel.oversampling();
            self.jots_per_rate = oversampling;
            let pixels = self.first_column / oversampling..stop.div_ceil(oversampling);
            exposure.pixel_rates(row / oversampling, pixels, response, &mut self.rates);
        } else {
            self.jots_per_rate = 1;
            exposure.jot_rates(row, self.first_column..stop, &mut self.rates);
            if sensor.dead.is_some() {
                for (column, rate) in (self.first_column..stop).zip(&mut self.rates) {
                    if sensor.is_dead(row, column) {
                        *rate = 0.0;
                    }
                }
            }
        }
    }

    /// Look up the probabilities of the jots from `first_column` to `stop`, and resize the buffers
    /// to the number of these jots.
    fn look_up_probabilities(&mut self, stop: usize) {
        let length = stop - self.first_column;
        let probabilities = &mut self.jot_probabilities;
        if self.jots_per_rate == 1 {
            self.table.look_up(&self.rates, probabilities);
        } else {
            self.table
                .look_up(&self.rates, &mut self.rate_probabilities);
            probabilities.resize(self.rates.len() * self.jots_per_rate, 0);
            let runs = probabilities.chunks_exact_mut(self.jots_per_rate);
            for (run, probability) in runs.zip(&self.rate_probabilities) {
                run.fill(*probability);
            }
            probabilities.drain(..self.first_column % self.jots_per_rate);
            probabilities.truncate(length);
        }
        let words = length.div_ceil(64);
        probabilities.resize(words * 64, 0);
        self.draws.resize(words * 128, 0);
        self.words.resize(words, 0);
        self.undecided.resize(words, false);
    }

    /// Draw b = [U < P(b = 1)] for a segment, where U is a uniform random number of 48 bits.
    ///
    /// The first 16 bits of U nearly always decide the comparison. The other 32 bits are drawn only
    /// if they do not.
    fn draw_words(&mut self, stream: RowStream, threshold: &Threshold) {
        self.random
            .fill_draws(stream, self.first_column, &mut self.draws);
        let draws = self.draws.as_chunks::<128>().0;
        let probabilities = self.jot_probabilities.as_chunks::<64>().0;
        compare(draws, probabilities, &mut self.words, &mut self.undecided);
        for (index, (draws, probabilities)) in draws.iter().zip(probabilities).enumerate() {
            if self.undecided[index] {
                let mut word = self.words[index];
                let draws = draws.as_chunks().0;
                for (jot, (draw, &probability)) in draws.iter().zip(probabilities).enumerate() {
                    let draw = u16::from_le_bytes(*draw);
                    if draw.abs_diff(probability) > ProbabilityTable::MARGIN {
                        continue;
                    }
                    let column = self.first_column + index * 64 + jot;
                    let rate = column / self.jots_per_rate - self.first_column / self.jots_per_rate;
                    // The padding beyond the end of the row has no rate. Its bits are not written.
                    let Some(&rate) = self.rates.get(rate) else {
                        continue;
                    };
                    let low = self.random.refinement(stream, column);
                    let draw = u64::from(draw) << 32 | u64::from(low);
                    let bit = 1 << (63 - jot);
                    if draw < exact_probability(threshold, rate) {
                        word |= bit;
                    } else {
                        word &= !bit;
                    }
                }
                self.words[index] = word;
            }
        }
    }
}

levels! {
    /// Compare 64 draws per word with their probabilities.
    ///
    /// A bit of `words` is 1 if the draw is below its probability. The first draw is the most
    /// significant bit. `undecided` is true if a draw of the word is close to its probability.
    fn compare(
        draws: &[[u8; 128]], probabilities: &[[u16; 64]], words: &mut [u64], undecided: &mut [bool],
    ) = compare_inlined;
}

#[inline(always)]
fn compare_inlined(
    draws: &[[u8; 128]],
    probabilities: &[[u16; 64]],
    words: &mut [u64],
    undecided: &mut [bool],
) {
    let out = words.iter_mut().zip(undecided);
    for ((draws, probabilities), (word, undecided)) in draws.iter().zip(probabilities).zip(out) {
        let mut bits = [0u8; 64];
        let mut any_close = 0;
        let draws = draws.as_chunks::<2>().0;
        for ((bit, draw), &probability) in bits.iter_mut().zip(draws).zip(probabilities) {
            let draw = u16::from_le_bytes(*draw);
            *bit = u8::from(draw < probability);
            any_close |= u16::from(draw.abs_diff(probability) <= ProbabilityTable::MARGIN);
        }
        *word = pack(&bits);
        *undecided = any_close != 0;
    }
}

/// Return a word of 64 bits from 64 bytes of 0 or 1. The first byte is the most significant bit.
#[inline(always)]
fn pack(bits: &[u8; 64]) -> u64 {
    bits.as_chunks::<8>().0.iter().fold(0, |word, &eight| {
        // The multiplication collects the lowest bit of each byte in the highest byte.
        let byte = u64::from_be_bytes(eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        word << 8 | byte
    })
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
    let mut whole_words = 0;
    if offset == 0
        && let Some(out) = out.as_slice_mut()
    {
        whole_words = length / 64;
        let out = out[byte..].as_chunks_mut::<8>().0;
        for (out, word) in out.iter_mut().zip(&words[..whole_words]) {
            *out = word.to_be_bytes();
        }
    }
    let rest = out.iter_mut().skip(byte).take(length.div_ceil(8));
    for (index, out) in rest.enumerate().skip(8 * whole_words) {
        let bit = offset + 8 * index;
        let (word, shift) = div_rem(bit, 64);
        let mut value = words[word] << shift;
        if shift > 56 && word + 1 < words.len() {
            value |= words[word + 1] >> (64 - shift);
        }
        let remaining = length - 8 * index;
        let mask = if remaining < 8 {
            !(0xff >> remaining)
        } else {
            0xff
        };
        *out = (value >> 56) as u8 & mask;
    }
}
