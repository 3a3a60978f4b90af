//! The probabilities of many readings at one rate, which share their sums over photons.

use super::Response;
use super::noise::Noise;
use super::poisson::ln_poisson;

impl Response {
    /// Write P(R = r) at a rate s into `out`, for the readings r from `first` on. It is 0 beyond
    /// the highest reading.
    ///
    /// The absolute errors are below 1e-13. [`Self::ln_probability`] has small relative errors too,
    /// but computes a sum for each reading.
    pub fn write_probabilities(&self, first: u32, s: f64, out: &mut [f64]) {
        out.fill(0.0);
        let top = self.max_reading();
        let end = u64::from(first) + out.len() as u64;
        let inside = out.len().min(top.saturating_sub(first) as usize);
        let start = self.lowest + i64::from(first);
        match &self.noise {
            _ if s.is_nan() => out[..inside].fill(s),
            _ if s == f64::INFINITY => {}
            Some(noise) => add_levels(noise, start, s, &mut out[..inside]),
            None if s <= 0.0 => {}
            None => {
                for (l, out) in (start..).zip(&mut out[..inside]) {
                    *out = ln_poisson(l as f64, s).exp();
                }
            }
        }
        // The lowest and the highest reading stand for many levels.
        for edge in [0, top] {
            if edge >= first && u64::from(edge) < end {
                out[(edge - first) as usize] = self.ln_probability(edge, s).exp();
            }
        }
    }
}

/// Add P(L = l) at a rate s to `out`, for the levels l from `start` on, with read noise.
fn add_levels(noise: &Noise, start: i64, s: f64, out: &mut [f64]) {
    let s = s.max(0.0);
    let weights = noise.weights();
    let width = (weights.len() / 2) as i64;
    let reach = 12.0 * s.sqrt() + 30.0;
    let end = start + out.len() as i64;
    let first = ((s - reach).max(0.0) as i64).max(start - width);
    let last = ((s + reach) as i64).min(end - 1 + width);
    if first > last {
        return;
    }
    let mode = (s as i64).clamp(first, last);
    let largest = ln_poisson(mode as f64, s).exp();
    let mut add = |y: i64, probability: f64| {
        let (from, to) = ((y - width).max(start), (y + width + 1).min(end));
        let skipped = (from - (y - width)) as usize;
        let own = &mut out[(from - start) as usize..(to - start) as usize];
        for (out, weight) in own.iter_mut().zip(&weights[skipped..]) {
            *out += probability * weight;
        }
    };
    let mut probability = largest;
    for y in mode..=last {
        add(y, probability);
        probability *= s / (y + 1) as f64;
    }
    probability = largest;
    for y in (first..mode).rev() {
        probability *= (y + 1) as f64 / s;
        add(y, probability);
    }
}

#[cfg(test)]
mod tests {
    use crate::error::Result;
    use crate::multibit::Response;

    #[test]
    fn probabilities_are_those_of_single_readings() -> Result<()> {
        let rates = [0.0, 1e-9, 0.3, 4.0, 60.0, 255.0, 900.0, f64::INFINITY];
        for noise in [0.0, 0.05, 0.4, 2.0, 30.0] {
            for (highest, threshold) in [(1, 1), (1, 5), (3, 1), (255, 1), (1023, 1)] {
                let response = Response::new(highest, noise, threshold)?;
                for s in rates {
                    for first in [0, 1, 200] {
                        let mut found = vec![f64::NAN; 300];
                        response.write_probabilities(first, s, &mut found);
                        for (reading, found) in (first..).zip(found) {
                            let exact = if reading > highest {
                                0.0
                            } else {
                                response.ln_probability(reading, s).exp()
                            };
                            assert!(
                                (found - exact).abs() < 1e-13,
                                "noise {noise}, rate {s}, reading {reading}: {found} {exact}"
                            );
                        }
                    }
                }
            }
        }
        Ok(())
    }
}
