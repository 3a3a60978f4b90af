//! The weight of each number of photons in a reading: read noise, rounding, and clipping.

use std::f64::consts::{PI, SQRT_2};

/// Return log Φ(x), where Φ is the standard normal distribution.
fn ln_normal(x: f64) -> f64 {
    if x > -30.0 {
        return (0.5 * libm::erfc(-x / SQRT_2)).ln();
    }
    let inverse = 1.0 / (x * x);
    let series =
        1.0 - inverse * (1.0 - 3.0 * inverse * (1.0 - 5.0 * inverse * (1.0 - 7.0 * inverse)));
    -0.5 * x * x - (-x * (2.0 * PI).sqrt()).ln() + series.ln()
}

/// The values of a level: a whole number, to which photons plus read noise are rounded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Level {
    /// This number.
    Exactly(i64),
    /// This number or a smaller one.
    AtMost(i64),
    /// This number or a larger one.
    AtLeast(i64),
}

/// Read noise of standard deviation σ > 0, with tables of the weights of near levels.
///
/// The weight of y photons in a level l is P(round(y + σ N) = l), which depends on z = y − l.
#[derive(Clone, Debug)]
pub(super) struct Noise {
    sigma: f64,
    /// log P(round(z + σ N) = 0) for z = 0, 1, …
    cells: Vec<f64>,
    /// log P(round(z + σ N) ≥ 0) for z = −n, …, n.
    upper: Vec<f64>,
    /// Ratios of successive weights of `cells`, and of `upper`.
    cell_ratios: Vec<f64>,
    upper_ratios: Vec<f64>,
    /// P(round(z + σ N) = 0) for z = −n, …, n.
    weights: Vec<f64>,
}

impl Noise {
    pub fn new(sigma: f64) -> Self {
        let number = (9.0 * sigma).ceil() as i64 + 8;
        let mut noise = Self {
            sigma,
            cells: Vec::new(),
            upper: Vec::new(),
            cell_ratios: Vec::new(),
            upper_ratios: Vec::new(),
            weights: Vec::new(),
        };
        noise.cells = (0..=number).map(|z| noise.ln_cell(z)).collect();
        noise.upper = (-number..=number).map(|z| noise.ln_upper(z)).collect();
        let ratios = |values: &[f64]| values.windows(2).map(|w| (w[1] - w[0]).exp()).collect();
        noise.cell_ratios = ratios(&noise.cells);
        noise.upper_ratios = ratios(&noise.upper);
        let cell = |z: i64| noise.cells[z.unsigned_abs() as usize].exp();
        noise.weights = (-number..=number).map(cell).collect();
        noise
    }

    pub fn sigma(&self) -> f64 {
        self.sigma
    }

    /// Return the weights of −n to n photons more than a level in this level. Those of more photons
    /// are below 1e-19.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Return the weight of y + 1 photons in a level over that of y photons.
    pub fn weight_ratio(&self, level: Level, y: i64) -> f64 {
        let known = match level {
            Level::Exactly(l) if y >= l => self.cell_ratios.get((y - l) as usize).copied(),
            Level::Exactly(l) => self.cell_ratios.get((l - y - 1) as usize).map(|r| 1.0 / r),
            Level::AtLeast(l) => self.upper_ratio(y - l),
            Level::AtMost(l) => self.upper_ratio(l - y - 1).map(|r| 1.0 / r),
        };
        known.unwrap_or_else(|| (self.ln_weight(level, y + 1) - self.ln_weight(level, y)).exp())
    }

    /// Return the ratio of the weights of z + 1 and z in `upper`, if the table contains it.
    fn upper_ratio(&self, z: i64) -> Option<f64> {
        let middle = (self.upper.len() / 2) as i64;
        if z >= middle {
            return Some(1.0);
        }
        self.upper_ratios
            .get(usize::try_from(z + middle).ok()?)
            .copied()
    }

    /// Return the logarithm of the weight of y photons in a level.
    pub fn ln_weight(&self, level: Level, y: i64) -> f64 {
        match level {
            Level::Exactly(l) => {
                let z = (y - l).abs();
                let known = self.cells.get(z as usize);
                known.copied().unwrap_or_else(|| self.ln_cell(z))
            }
            Level::AtLeast(l) => self.ln_upper_or_known(y - l),
            Level::AtMost(l) => self.ln_upper_or_known(l - y),
        }
    }

    fn ln_upper_or_known(&self, z: i64) -> f64 {
        let middle = (self.upper.len() / 2) as i64;
        if z > middle {
            return 0.0;
        }
        let known = usize::try_from(z + middle).ok().map(|z| self.upper[z]);
        known.unwrap_or_else(|| self.ln_upper(z))
    }

    fn ln_cell(&self, z: i64) -> f64 {
        let distance = z as f64;
        if z == 0 {
            return libm::erf(0.5 / self.sigma / SQRT_2).ln();
        }
        let near = ln_normal((0.5 - distance) / self.sigma);
        let far = ln_normal((-0.5 - distance) / self.sigma);
        near + (-(far - near).exp_m1()).ln()
    }

    fn ln_upper(&self, z: i64) -> f64 {
        ln_normal((z as f64 + 0.5) / self.sigma)
    }
}
