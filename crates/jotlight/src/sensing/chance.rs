//! P(b = 1) as the whole number that a random draw is compared with.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::likelihood::Threshold;

/// P(b = 1) in units of 2⁻⁴⁸, the highest being 1 − 2⁻⁴⁸.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Chance(u64);

impl Chance {
    pub const NEVER: Self = Self(0);
    const UNITS: f64 = (1u64 << 48) as f64;

    /// From a probability in units already.
    fn from_units(units: f64) -> Self {
        // A float between 2⁵² and 2⁵³ holds a whole number in its lowest bits: rounding without the checks of a cast.
        const WHOLE: f64 = (1u64 << 52) as f64;
        Self((units.clamp(0.0, Self::UNITS - 1.0) + WHOLE).to_bits() & ((1 << 48) - 1))
    }

    /// The 16 bits that decide nearly always.
    pub fn high(self) -> u16 {
        (self.0 >> 32) as u16
    }

    /// The 32 bits that decide the rest.
    pub fn low(self) -> u32 {
        self.0 as u32
    }
}

/// P(q, s) as a cubic polynomial between any two nodes, from its values and slopes there: off by less than 3·10⁻¹², a fraction of
/// the time of an exponential, and the same time for every q.
#[derive(Debug)]
pub(super) struct ChanceTable {
    /// Coefficients of 1, t, t², t³ with t in \[0, 1\] from node to node, in units of a [`Chance`].
    cubics: Vec<[f64; 4]>,
}

impl ChanceTable {
    /// Nodes per expected photon.
    const DENSITY: f64 = 256.0;

    /// The table of a threshold, made once.
    pub fn of(threshold: Threshold) -> Arc<Self> {
        static TABLES: Mutex<Option<HashMap<u32, Arc<ChanceTable>>>> = Mutex::new(None);
        // A table is complete before it enters the map, so a panic elsewhere leaves nothing half made.
        TABLES
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get_or_insert_default()
            .entry(threshold.photons())
            .or_insert_with(|| Arc::new(Self::new(threshold)))
            .clone()
    }

    fn new(threshold: Threshold) -> Self {
        let certain = Chance::UNITS * (1.0 - (-50f64).exp2());
        let node = |index: usize| {
            let rate = index as f64 / Self::DENSITY;
            (
                Chance::UNITS * threshold.fires(rate),
                Chance::UNITS * threshold.slope(rate) / Self::DENSITY,
            )
        };
        let mut cubics = Vec::new();
        let (mut left, mut left_slope) = node(0);
        while left < certain {
            let (right, right_slope) = node(cubics.len() + 1);
            let rise = right - left;
            cubics.push([
                left,
                left_slope,
                3.0 * rise - 2.0 * left_slope - right_slope,
                left_slope + right_slope - 2.0 * rise,
            ]);
            (left, left_slope) = (right, right_slope);
        }
        // Past the last node every jot fires.
        cubics.push([Chance::UNITS, 0.0, 0.0, 0.0]);
        Self { cubics }
    }

    /// P(b = 1) at each of `rates`, into `chances`.
    #[inline(never)]
    pub fn chances(&self, rates: &[f64], chances: &mut Vec<Chance>) {
        chances.resize(rates.len(), Chance::NEVER);
        for (chance, &rate) in chances.iter_mut().zip(rates) {
            *chance = self.chance(rate);
        }
    }

    /// P(b = 1) at the rate `rate` ≥ 0.
    pub fn chance(&self, rate: f64) -> Chance {
        let place = (rate * Self::DENSITY).min((self.cubics.len() - 1) as f64);
        let index = place as u32;
        let t = place - f64::from(index);
        let [c0, c1, c2, c3] = self.cubics[index as usize];
        // For q of 4 and more the first cubic dips below 0.
        Chance::from_units(c0 + t * (c1 + t * (c2 + t * c3)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    #[test]
    fn the_table_agrees_with_the_formula() -> Result<()> {
        for q in [1, 2, 3, 4, 5, 6, 40] {
            let threshold = Threshold::new(q)?;
            let table = ChanceTable::of(threshold);
            let faint = (0..4_000).map(|step| f64::from(step) * 1.1e-5);
            for rate in faint.chain((0..40_000).map(|step| f64::from(step) * 0.00317)) {
                let exact = threshold.fires(rate) * Chance::UNITS;
                let off = (table.chance(rate).0 as f64 - exact) / Chance::UNITS;
                assert!(off.abs() < 3e-12, "q = {q}, s = {rate}: {off}");
            }
        }
        Ok(())
    }

    #[test]
    fn faint_light_keeps_its_relative_accuracy() -> Result<()> {
        let threshold = Threshold::new(1)?;
        for rate in [1e-9, 1e-7, 1e-5, 1e-3] {
            let chance = ChanceTable::of(threshold).chance(rate).0 as f64 / Chance::UNITS;
            assert!((chance / rate - 1.0 + 0.5 * rate).abs() < 1e-5);
        }
        Ok(())
    }
}
