//! What a draw is compared with: P(b = 1), roughly from a table, and exactly only for the few draws that come close to it.

use std::sync::{Arc, Mutex, PoisonError};

use crate::cpu::levels;
use crate::likelihood::Threshold;
use crate::numbers::Real;

/// P(b = 1) = P(q, s) in units of 2⁻¹⁶, tabulated over s: off by less than [`Bounds::MARGIN`].
#[derive(Debug)]
pub(super) struct Bounds {
    /// Entries per expected photon.
    density: f64,
    /// The last of them.
    last: f64,
    /// [`ENTRIES`] of them.
    table: Vec<u32>,
}

/// More than the table of any threshold has, and so many that an index of 17 bits need not be checked.
const ENTRIES: usize = 1 << 17;

impl Bounds {
    /// Entries over which P would rise from 0 to 1 if it were as steep all over as where it is steepest.
    const STEEPEST: f64 = 1024.0;

    /// A draw of 16 bits that is further than this from its bound is on the same side of the exact probability: over half an
    /// entry P rises by up to 32 units, and the bound and the draw are rounded to a unit each.
    pub const MARGIN: u16 = 34;

    /// The table of a threshold, made once.
    pub fn of(threshold: Threshold) -> Arc<Self> {
        static TABLES: Mutex<Vec<(u32, Arc<Bounds>)>> = Mutex::new(Vec::new());
        let photons = threshold.photons();
        let tables = || TABLES.lock().unwrap_or_else(PoisonError::into_inner);
        let known = tables().iter().find(|(of, _)| *of == photons).cloned();
        if let Some((_, table)) = known {
            return table;
        }
        // Not while others wait; two that come here at once both make it.
        let table = Arc::new(Self::new(threshold));
        tables().push((photons, Arc::clone(&table)));
        table
    }

    fn new(threshold: Threshold) -> Self {
        // dP/ds is largest at s = q − 1.
        let density = Self::STEEPEST * threshold.slope(f64::from(threshold.photons() - 1));
        let mut table = vec![0; ENTRIES];
        let mut last = 0.0;
        for entry in &mut table {
            let probability = threshold.fires((last + 0.5) / density);
            *entry = (probability * 65536.0).min(65535.0).round() as u32;
            // The last entry stands for all brighter light.
            if 1.0 - probability < 1e-6 {
                break;
            }
            last += 1.0;
        }
        Self {
            density,
            last,
            table,
        }
    }

    /// The bounds for detection rates of at least 0.
    pub fn look_up(&self, rates: &[f64], bounds: &mut Vec<u16>) {
        bounds.resize(rates.len(), 0);
        look_up(self, rates, bounds);
    }

    /// In two loops, each of which becomes vector code.
    #[inline(always)]
    fn of_group(&self, table: &[u32; ENTRIES], rates: &[f64; GROUP]) -> [u16; GROUP] {
        let mut places = [0; GROUP];
        for (place, rate) in places.iter_mut().zip(rates) {
            // Half an entry less and then the nearest is the entry that the rate lies in; on its edge either will do.
            let entry = rate * self.density - 0.5;
            let entry = if entry < self.last { entry } else { self.last };
            let entry = if entry > 0.0 { entry } else { 0.0 };
            *place = entry.nearest().1;
        }
        places.map(|place| table[place as usize % ENTRIES] as u16)
    }
}

/// Rates that are worked on at a time.
const GROUP: usize = 64;

levels! {
    fn look_up(bounds: &Bounds, rates: &[f64], out: &mut [u16]) = look_up_inlined;
}

#[inline(always)]
fn look_up_inlined(bounds: &Bounds, rates: &[f64], out: &mut [u16]) {
    let Some(table) = bounds.table.first_chunk() else {
        return;
    };
    let (groups, rest) = rates.as_chunks::<GROUP>();
    let (of_groups, of_rest) = out.as_chunks_mut::<GROUP>();
    for (rates, out) in groups.iter().zip(of_groups) {
        *out = bounds.of_group(table, rates);
    }
    let mut group = [0.0; GROUP];
    group[..rest.len()].copy_from_slice(rest);
    of_rest.copy_from_slice(&bounds.of_group(table, &group)[..rest.len()]);
}

/// P(b = 1) in units of 2⁻⁴⁸.
pub(super) fn exactly(threshold: &Threshold, rate: f64) -> u64 {
    (threshold.fires(rate) * 48f64.exp2()).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    #[test]
    fn no_bound_is_further_from_the_probability_than_the_margin_allows() -> Result<()> {
        for q in [1, 2, 5, 40, 3000] {
            let threshold = Threshold::new(q)?;
            let step = 0.000_017_3 * f64::from(q + 100);
            let mut rates: Vec<f64> = (0..200_000).map(|k| f64::from(k) * step).collect();
            rates.extend([0.0, 1e-300, 1e4, 1e300, f64::INFINITY]);
            let mut bounds = Vec::new();
            Bounds::of(threshold).look_up(&rates, &mut bounds);
            for (rate, bound) in rates.iter().zip(bounds) {
                let exact = 65536.0 * threshold.fires(*rate);
                // One unit of the margin is for the draw, which stands for all that begin with its 16 bits.
                let off = (f64::from(bound) - exact).abs();
                assert!(
                    off <= f64::from(Bounds::MARGIN - 1),
                    "q = {q}, s = {rate}: {off}"
                );
            }
        }
        Ok(())
    }
}
