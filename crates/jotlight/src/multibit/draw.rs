//! Random readings of several bits.

use ndarray::{ArrayViewMut1, ArrayViewMut3, Axis};
use rayon::prelude::*;

use super::Response;
use super::poisson::poisson_quantile;
use crate::error::{Error, Result};
use crate::interrupt;
use crate::rng::{ALIGNMENT, JotRandom, MAX_REFINEMENTS, NOISE_BYTES, REFINEMENT_BITS, RowStream};
use crate::sensing::{Exposure, Image, JOTS_PER_SEGMENT, Sensor, Window};

/// Draw the readings of a window of frames and pixels into `out` `(frames, rows·K̂, columns·K̂)`.
///
/// The numbers of photons come from the random numbers of the bits of [`crate::sensing::expose`]:
/// without read noise, a reading is at least q where the bit of a sensor with threshold q is 1.
/// Read noise has random numbers of its own. A dead jot reports 0. The threshold of `sensor` is not
/// used.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the window
/// exceeds the image, if a parameter of the sensor or an intensity is infinite, NaN, or negative, or
/// if there are too many frames, rows, or channels for the random streams.
pub fn draw(
    sensor: &Sensor<'_>,
    response: &Response,
    image: Image<'_>,
    seed: [u8; 32],
    channel: usize,
    window: &Window,
    mut out: ArrayViewMut3<'_, u16>,
) -> Result<()> {
    let (rows, columns) = sensor.check_draw(&image, channel, window)?;
    let expected = (window.frames.len(), rows.len(), columns.len());
    if out.dim() != expected {
        return Err(Error::shape("out", expected, out.dim()));
    }
    if out.is_empty() {
        return Ok(());
    }
    let exposure = Exposure { sensor, image };
    out.axis_iter_mut(Axis(1))
        .into_par_iter()
        .enumerate()
        .for_each_init(
            || RowDrawer::new(seed, response),
            |drawer, (row, mut out)| {
                let row = rows.start + row;
                for start in columns.clone().step_by(JOTS_PER_SEGMENT) {
                    let stop = (start + JOTS_PER_SEGMENT).min(columns.end);
                    exposure.jot_rates(row, start..stop, &mut drawer.rates);
                    for (column, rate) in (start..stop).zip(&mut drawer.rates) {
                        if sensor.is_dead(row, column) {
                            *rate = f64::NAN;
                        }
                    }
                    for (frame, mut out) in window.frames.clone().zip(out.outer_iter_mut()) {
                        if interrupt::is_requested() {
                            return;
                        }
                        let stream = RowStream::new(channel, frame, row);
                        let place = start - columns.start..stop - columns.start;
                        drawer.draw(stream, start, &mut out.slice_mut(ndarray::s![place]));
                    }
                }
            },
        );
    Ok(())
}

/// The random numbers and the buffers of a thread.
struct RowDrawer<'r> {
    random: JotRandom,
    response: &'r Response,
    /// The rates of the jots of a segment, NaN for dead jots.
    rates: Vec<f64>,
    draws: Vec<[u8; ALIGNMENT]>,
    noise: Vec<[u8; NOISE_BYTES]>,
}

impl<'r> RowDrawer<'r> {
    fn new(seed: [u8; 32], response: &'r Response) -> Self {
        Self {
            random: JotRandom::new(seed),
            response,
            rates: Vec::new(),
            draws: Vec::new(),
            noise: Vec::new(),
        }
    }

    /// Draw the readings of a segment of a row, which starts at `column`.
    fn draw(&mut self, stream: RowStream, column: usize, out: &mut ArrayViewMut1<'_, u16>) {
        let offset = column % ALIGNMENT;
        let groups = (offset + self.rates.len()).div_ceil(ALIGNMENT);
        self.draws.resize(groups, [0; ALIGNMENT]);
        self.random
            .fill_draws(stream, column - offset, &mut self.draws);
        let draws = &self.draws.as_flattened()[offset..];
        let mut refinements = [0; MAX_REFINEMENTS];
        let sigma = self.response.noise.as_ref().map(super::Noise::sigma);
        if sigma.is_some() {
            self.noise.resize(self.rates.len(), [0; NOISE_BYTES]);
            self.random.fill_noise(stream, column, &mut self.noise);
        }
        for (index, (&rate, out)) in self.rates.iter().zip(out).enumerate() {
            if index % MAX_REFINEMENTS == 0 {
                let columns = std::array::from_fn::<_, MAX_REFINEMENTS, _>(|k| column + index + k);
                refinements = self.random.refinements(stream, &columns);
            }
            if rate.is_nan() {
                *out = 0;
                continue;
            }
            let refinement = refinements[index % MAX_REFINEMENTS];
            let bits = u64::from(draws[index]) << REFINEMENT_BITS | refinement;
            // One half makes [u < P] the same as that of bits, whose P is rounded to 48 bits.
            let u = (bits as f64 + 0.5) / 48f64.exp2();
            let reach = sigma.map_or(0.0, |sigma| 10.0 * sigma + 2.0);
            let highest = self.response.highest as f64 + reach;
            let mut level = poisson_quantile(u, rate, highest);
            if let Some(sigma) = sigma {
                level = (level + sigma * normal(self.noise[index])).round();
            }
            let reading = level.clamp(self.response.lowest as f64, self.response.highest as f64);
            *out = (reading - self.response.lowest as f64) as u16;
        }
    }
}

/// Return a standard normal number from random bytes (Box and Muller).
fn normal(bytes: [u8; NOISE_BYTES]) -> f64 {
    let word = u128::from_le_bytes(bytes);
    let uniform = |word: u64| ((word >> 12) as f64 + 0.5) / 52f64.exp2();
    let (u, v) = (uniform(word as u64), uniform((word >> 64) as u64));
    (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
}
