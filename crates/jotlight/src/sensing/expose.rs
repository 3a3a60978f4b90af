//! Bits, drawn straight into packed words.

use std::sync::Arc;

use ndarray::{ArrayViewMut1, ArrayViewMut3, Axis};
use rayon::prelude::*;

use super::bound::{Bounds, exactly};
use super::rate::Light;
use super::{Image, Sensor, Window};
use crate::bits::packed_width;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::likelihood::Threshold;
use crate::rng::{ALIGNMENT, JotRandom, RowPlace, check_size};

/// Jots of a row that are drawn at a time; bounds the memory of a thread.
const STRETCH: usize = 2048;

/// Jots that make it worth while to start a task.
const TASK: usize = 1 << 13;

/// Draws the bits of a window of frames and pixels into `out` `(frames, rows·K̂, ⌈columns·K̂ / 8⌉)`, most significant bit first.
///
/// Each jot has a place of its own in the stream of random numbers, so that a window holds exactly the bits that
/// the whole would hold there, and `channel` keeps the channels of a colour image independent.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] when there are too many frames or rows.
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
    let side = sensor.kernel.oversampling();
    check_size(channel, window.frames.end, image.shape().0 * side)?;
    let expected = (
        window.frames.len(),
        window.rows.len() * side,
        packed_width(window.columns.len() * side),
    );
    if out.dim() != expected {
        return Err(Error::shape("out", expected, out.dim()));
    }

    let light = Light { sensor, image };
    let jots_per_row = window.frames.len() * side * side * window.columns.len();
    // One task a row of pixels, with that row's bits of all frames: probabilities are found once for all frames.
    out.axis_chunks_iter_mut(Axis(1), side)
        .into_par_iter()
        .enumerate()
        .with_min_len((TASK / jots_per_row.max(1)).max(1))
        .for_each_init(
            || Scratch::new(seed, sensor.threshold),
            |scratch, (row, mut out)| {
                scratch.draw_pixels(&light, window.rows.start + row, channel, window, &mut out);
            },
        );
    Ok(())
}

/// What a thread needs for a stretch of a row.
struct Scratch {
    random: JotRandom,
    table: Arc<Bounds>,
    /// η s + d, one for so many jots in a row, the first of them with column `base`.
    rates: Vec<f64>,
    jots_per_rate: usize,
    base: usize,
    /// The bound of each rate, and of each jot, in whole words.
    of_rates: Vec<u16>,
    bounds: Vec<u16>,
    bytes: Vec<u8>,
    words: Vec<u64>,
    /// Whether a draw of the word is close to its bound.
    close: Vec<bool>,
}

impl Scratch {
    fn new(seed: [u8; 32], threshold: Threshold) -> Self {
        Self {
            random: JotRandom::new(seed),
            table: Bounds::of(threshold),
            rates: Vec::new(),
            jots_per_rate: 1,
            base: 0,
            of_rates: Vec::new(),
            bounds: Vec::new(),
            bytes: Vec::new(),
            words: Vec::new(),
            close: Vec::new(),
        }
    }

    /// Draws a row of pixels, that is K̂ rows of jots, of all frames.
    fn draw_pixels(
        &mut self,
        light: &Light<'_, '_, '_>,
        pixel_row: usize,
        channel: usize,
        window: &Window,
        out: &mut ArrayViewMut3<'_, u8>,
    ) {
        let side = light.sensor.kernel.oversampling();
        let end = window.columns.end * side;
        let mut start = window.columns.start * side;
        let mut byte = 0;
        while start < end {
            let stop = (start + STRETCH).min(end);
            // Draws begin at an aligned column; the few before `start` belong to the neighbouring tile and are shifted out.
            self.base = start / ALIGNMENT * ALIGNMENT;
            for line in 0..side {
                let row = pixel_row * side + line;
                if line == 0 || light.sensor.blockwise().is_none() {
                    self.prepare(light, row, stop);
                }
                let mut out = out.index_axis_mut(Axis(1), line);
                for (frame, mut out) in window.frames.clone().zip(out.outer_iter_mut()) {
                    self.draw_words(RowPlace::new(channel, frame, row), &light.sensor.threshold);
                    write_bits(&self.words, start - self.base, stop - start, byte, &mut out);
                }
            }
            byte += STRETCH / 8;
            start = stop;
        }
    }

    /// Rates and bounds of the jots up to `stop`.
    fn prepare(&mut self, light: &Light<'_, '_, '_>, row: usize, stop: usize) {
        let sensor = light.sensor;
        if let Some(response) = sensor.blockwise() {
            let side = sensor.kernel.oversampling();
            self.jots_per_rate = side;
            let pixels = self.base / side..stop.div_ceil(side);
            light.block_detections(row / side, pixels, response, &mut self.rates);
        } else {
            self.jots_per_rate = 1;
            light.detections(row, self.base..stop, &mut self.rates);
            if sensor.dead.is_some() {
                for (column, rate) in (self.base..stop).zip(&mut self.rates) {
                    if sensor.is_dead(row, column) {
                        *rate = 0.0;
                    }
                }
            }
        }
        let length = stop - self.base;
        if self.jots_per_rate == 1 {
            self.table.look_up(&self.rates, &mut self.bounds);
        } else {
            self.table.look_up(&self.rates, &mut self.of_rates);
            self.bounds.resize(self.rates.len() * self.jots_per_rate, 0);
            let runs = self.bounds.chunks_exact_mut(self.jots_per_rate);
            for (run, bound) in runs.zip(&self.of_rates) {
                run.fill(*bound);
            }
            self.bounds.drain(..self.base % self.jots_per_rate);
            self.bounds.truncate(length);
        }
        let words = length.div_ceil(64);
        self.bounds.resize(words * 64, 0);
        self.bytes.resize(words * 128, 0);
        self.words.resize(words, 0);
        self.close.resize(words, false);
    }

    /// b = [U < P(b = 1)] with U uniform of 48 bits, of which the first 16 nearly always decide.
    fn draw_words(&mut self, place: RowPlace, threshold: &Threshold) {
        self.random.draws(place, self.base, &mut self.bytes);
        let draws = self.bytes.as_chunks::<128>().0;
        let bounds = self.bounds.as_chunks::<64>().0;
        compare(draws, bounds, &mut self.words, &mut self.close);
        for (index, (draws, bounds)) in draws.iter().zip(bounds).enumerate() {
            if self.close[index] {
                let mut word = self.words[index];
                for (jot, (draw, &bound)) in draws.as_chunks().0.iter().zip(bounds).enumerate() {
                    let draw = u16::from_le_bytes(*draw);
                    if draw.abs_diff(bound) > Bounds::MARGIN {
                        continue;
                    }
                    let column = self.base + index * 64 + jot;
                    let rate = column / self.jots_per_rate - self.base / self.jots_per_rate;
                    // Past the end of the row there is no rate, and no bit is kept.
                    let Some(&rate) = self.rates.get(rate) else {
                        continue;
                    };
                    let low = self.random.refinement(place, column);
                    let draw = u64::from(draw) << 32 | u64::from(low);
                    let bit = 1 << (63 - jot);
                    if draw < exactly(threshold, rate) {
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
    /// Which draws are below their bounds, 64 of them to a word, the first in the most significant bit, and whether any of them is close to
    /// its bound.
    fn compare(draws: &[[u8; 128]], bounds: &[[u16; 64]], words: &mut [u64], close: &mut [bool]) = compare_inlined;
}

#[inline(always)]
fn compare_inlined(
    draws: &[[u8; 128]],
    bounds: &[[u16; 64]],
    words: &mut [u64],
    close: &mut [bool],
) {
    let out = words.iter_mut().zip(close);
    for ((draws, bounds), (word, is_close)) in draws.iter().zip(bounds).zip(out) {
        let mut below = [0u8; 64];
        let mut close = 0;
        for ((below, draw), &bound) in below.iter_mut().zip(draws.as_chunks::<2>().0).zip(bounds) {
            let draw = u16::from_le_bytes(*draw);
            *below = u8::from(draw < bound);
            close |= u16::from(draw.abs_diff(bound) <= Bounds::MARGIN);
        }
        *word = pack(&below);
        *is_close = close != 0;
    }
}

/// 64 bytes of 0 or 1 into a word, the first byte into the most significant bit.
#[inline(always)]
fn pack(bits: &[u8; 64]) -> u64 {
    bits.as_chunks::<8>().0.iter().fold(0, |word, &eight| {
        // The multiplication gathers the lowest bit of each byte in the highest byte.
        let byte = u64::from_be_bytes(eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        word << 8 | byte
    })
}

/// Writes `length` bits, from bit `offset` of `words` on, to `out` from byte `byte` on; padding bits are 0.
fn write_bits(
    words: &[u64],
    offset: usize,
    length: usize,
    byte: usize,
    out: &mut ArrayViewMut1<'_, u8>,
) {
    let mut whole = 0;
    if offset == 0
        && let Some(out) = out.as_slice_mut()
    {
        whole = length / 64;
        let out = out[byte..].as_chunks_mut::<8>().0;
        for (out, word) in out.iter_mut().zip(&words[..whole]) {
            *out = word.to_be_bytes();
        }
    }
    let rest = out.iter_mut().skip(byte).take(length.div_ceil(8));
    for (index, out) in rest.enumerate().skip(8 * whole) {
        let bit = offset + 8 * index;
        let (word, shift) = (bit / 64, bit % 64);
        let mut value = words[word] << shift;
        if shift > 56 && word + 1 < words.len() {
            value |= words[word + 1] >> (64 - shift);
        }
        let left = length - 8 * index;
        let keep = if left < 8 { !(0xff >> left) } else { 0xff };
        *out = (value >> 56) as u8 & keep;
    }
}
