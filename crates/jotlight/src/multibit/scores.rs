//! The derivatives of the log-probability of each reading, interpolated between nodes.
//!
//! With read noise, the exact derivatives are sums over all numbers of photons that may be behind a
//! reading. An image has far more readings than the nodes that it needs.

use std::ops::Range;
use std::sync::OnceLock;

use super::Response;
use super::noise::{Level, Noise};
use super::table::{NODES, Place, node_at, rate_at};

/// The number of readings that have nodes. Those of more readings could fill the memory.
const MAX_READINGS: usize = 4096;

/// The distance of a rate from a reading, in standard deviations, up to which nodes are used.
const REACH: f64 = 8.0;

/// The derivative d log P(R = r)/ds at a node, and minus the second one.
type Node = OnceLock<[f64; 2]>;

/// The nodes of a reading near it.
#[derive(Debug)]
struct Nodes {
    /// The number of the first node.
    first: usize,
    known: Box<[Node]>,
}

/// The derivatives of the log-probability of each reading about the rate.
#[derive(Debug)]
pub struct ScoreTable<'a> {
    response: &'a Response,
    /// The nodes of each reading. They are empty without read noise.
    readings: Box<[OnceLock<Nodes>]>,
}

impl<'a> ScoreTable<'a> {
    /// Return the table of a response.
    #[must_use]
    pub fn new(response: &'a Response) -> Self {
        let number = match response.noise {
            Some(_) => (response.max_reading() as usize + 1).min(MAX_READINGS),
            None => 0,
        };
        let readings = (0..number).map(|_| OnceLock::new()).collect();
        Self { response, readings }
    }

    /// Return a function from a reading to d log P/ds and −d² log P/ds² at a rate s.
    ///
    /// It is accurate to about ten digits of the larger of l/s and 1, where l is the reading.
    pub fn at(&self, s: f64) -> impl Fn(u32) -> (f64, f64) {
        let is_tabulated = !self.readings.is_empty();
        let place = is_tabulated.then(|| Place::of(s)).flatten();
        move |reading| {
            let interpolated = place.as_ref().and_then(|place| {
                let nodes = self.readings.get(reading as usize)?;
                let nodes = nodes.get_or_init(|| self.nodes_near(reading));
                self.interpolate(nodes, place, reading)
            });
            interpolated.unwrap_or_else(|| self.response.score_and_curvature(reading, s))
        }
    }

    fn interpolate(&self, nodes: &Nodes, place: &Place, reading: u32) -> Option<(f64, f64)> {
        let known = place.of_nodes(&nodes.known, nodes.first)?;
        let (mut score, mut curvature) = (0.0, 0.0);
        for (index, (weight, node)) in place.weights.iter().zip(known).enumerate() {
            let [one, two] = node.get_or_init(|| {
                let rate = rate_at(place.first + index);
                self.response.score_and_curvature(reading, rate).into()
            });
            score += weight * one;
            curvature += weight * two;
        }
        let is_finite = score.is_finite() && curvature.is_finite();
        is_finite.then(|| (score, curvature.max(0.0)))
    }

    /// Return the nodes at rates near a reading, without their values.
    fn nodes_near(&self, reading: u32) -> Nodes {
        let Range { start, end } = self.rates_near(reading);
        let first = node_at(start);
        let number = node_at(end) + NODES - first;
        let known = (0..number).map(|_| OnceLock::new()).collect();
        Nodes { first, known }
    }

    /// Return the rates that usually cause a reading.
    fn rates_near(&self, reading: u32) -> Range<f64> {
        let sigma = self.response.noise.as_ref().map_or(0.0, Noise::sigma);
        let level = self.response.level(reading);
        let (Level::Exactly(l) | Level::AtMost(l) | Level::AtLeast(l)) = level;
        let l = l.max(0) as f64;
        let reach = REACH * (l + sigma * sigma + 1.0).sqrt();
        let end = match level {
            Level::AtLeast(_) => self.response.saturating_rate(),
            _ => l + reach,
        };
        match level {
            Level::AtMost(_) => 0.0..end,
            _ => (l - reach).max(0.0)..end,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    #[test]
    fn interpolated_derivatives_are_the_exact_ones() -> Result<()> {
        for (top, sigma, threshold) in [
            (1, 0.15, 1),
            (1, 0.4, 5),
            (3, 0.3, 1),
            (15, 1.0, 1),
            (255, 0.3, 1),
            (255, 5.0, 1),
            (65_535, 0.5, 1),
        ] {
            let response = Response::new(top, sigma, threshold)?;
            let table = ScoreTable::new(&response);
            for reading in [0, 1, 2, 7, 100, 4095, 4096, top - 1, top] {
                let level = f64::from(reading + threshold - 1);
                for rate in [
                    1e-80, 3e-12, 1e-5, 0.03, 0.7, 4.1, 17.3, 101.0, 4090.0, 1e40,
                ] {
                    let (score, curvature) = table.at(rate)(reading.min(top));
                    let exact = response.score_and_curvature(reading.min(top), rate);
                    let size = (level / rate).max(1.0);
                    assert!((score - exact.0).abs() <= 1e-10 * size);
                    assert!((curvature - exact.1).abs() <= 1e-9 * size * size.max(1.0 / rate));
                }
            }
        }
        Ok(())
    }
}
