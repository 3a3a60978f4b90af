//! A table of detection probabilities, with which random draws are compared (paper, equation (3)).
//!
//! The table holds P(b = 1), rounded to 16 bits. The exact probability is computed only for the few
//! draws that are close to the value of the table. The threshold 1 needs no table, because a short
//! polynomial approximates its exponential function.

use std::sync::Arc;

use crate::cpu::levels;
use crate::kept::Kept;
use crate::likelihood::Threshold;
use crate::numbers::Real;

/// P(b = 1) = P(q, s) in units of 2⁻¹⁶, tabulated over s.
#[derive(Debug)]
pub(super) struct ProbabilityTable {
    /// The number of entries per unit of s.
    density: f64,
    /// The number of entries that would precede the first one if the table began at s = 0. P is
    /// nearly 0 there, so the first entry represents them.
    first: f64,
    /// The index of the last entry that the table uses.
    last: f64,
    /// The [`ENTRIES`] entries, none for the threshold 1.
    entries: Vec<u32>,
    /// The maximum distance between a 16-bit draw and the value of the table for which the exact
    /// probability must decide, in units of 2⁻¹⁶.
    margin: u16,
}

/// The length of a table. No threshold needs more entries. The length is a power of 2, so that
/// `index % ENTRIES` is a single operation, which makes a bounds check unnecessary.
const ENTRIES: usize = 1 << 14;

static TABLES: Kept<ProbabilityTable> = Kept::new();

impl ProbabilityTable {
    /// The number of entries over which P would rise from 0 to 1 at its maximum slope.
    const ENTRIES_AT_MAX_SLOPE: f64 = 1024.0;

    /// P rises by up to 32 units over half an entry. Rounding of the value and of the draw adds one
    /// unit each.
    const MARGIN: u16 = 34;

    /// The polynomial has an error of less than half a unit, and rounding adds as above.
    const ONE_PHOTON_MARGIN: u16 = 2;

    /// Return the table of a threshold. Later calls reuse it.
    pub fn shared(threshold: Threshold) -> Arc<Self> {
        TABLES.get(threshold.photons(), || Self::new(threshold))
    }

    fn new(threshold: Threshold) -> Self {
        if threshold.is_one_photon() {
            return Self {
                density: 0.0,
                first: 0.0,
                last: 0.0,
                entries: Vec::new(),
                margin: Self::ONE_PHOTON_MARGIN,
            };
        }
        let q = f64::from(threshold.photons());
        // The maximum of dP/ds is at s = q − 1.
        let max_slope = threshold.detection_derivative(q - 1.0);
        let density = Self::ENTRIES_AT_MAX_SLOPE * max_slope;
        // P is below 10⁻⁶ at rates that are five standard deviations below q.
        let first = ((q - 5.0 * q.sqrt()).max(0.0) * density).floor();
        let mut entries = vec![0; ENTRIES];
        let mut last = 0.0;
        for entry in &mut entries {
            let probability = threshold.detection_probability((first + last + 0.5) / density);
            *entry = (probability * 65536.0).min(65535.0).round() as u32;
            // The last entry represents all higher rates.
            if 1.0 - probability < 1e-6 {
                break;
            }
            last += 1.0;
        }
        Self {
            density,
            first,
            last,
            entries,
            margin: Self::MARGIN,
        }
    }

    /// Replace `probabilities` with P(b = 1) in units of 2⁻¹⁶ for rates of at least 0.
    pub fn look_up(&self, rates: &[f64], probabilities: &mut Vec<u16>) {
        probabilities.resize(rates.len(), 0);
        if self.entries.is_empty() {
            one_photon(rates, probabilities);
        } else {
            look_up(self, rates, probabilities);
        }
    }

    /// Return the interval of 16-bit draws that a value of the table does not decide. A jot whose
    /// draw is below it reports 1, and a jot whose draw is above it reports 0.
    #[inline(always)]
    pub fn interval(&self, probability: u16) -> (u16, u16) {
        (
            probability.saturating_sub(self.margin),
            probability.saturating_add(self.margin),
        )
    }

    /// Return whether a draw of 48 bits is below a probability, unless a value of the table does
    /// not decide this.
    pub fn compare(&self, draw: u64, probability: u16) -> Option<bool> {
        let draw = (draw >> 32) as u16;
        let (low, high) = self.interval(probability);
        (draw < low || draw > high).then_some(draw < low)
    }

    /// Return the probabilities of a group of rates.
    ///
    /// The compiler vectorizes each of the two loops.
    #[inline(always)]
    fn look_up_group(
        &self,
        entries: &[u32; ENTRIES],
        rates: &[f64; RATES_PER_GROUP],
    ) -> [u16; RATES_PER_GROUP] {
        let mut indices = [0; RATES_PER_GROUP];
        let offset = self.first + 0.5;
        for (index, rate) in indices.iter_mut().zip(rates) {
            // Subtracting one half turns rounding to nearest into rounding down. On the edge
            // between two entries, either is accurate enough.
            let entry = rate * self.density - offset;
            let entry = if entry < self.last { entry } else { self.last };
            let entry = if entry > 0.0 { entry } else { 0.0 };
            *index = entry.nearest().1;
        }
        indices.map(|index| entries[index as usize % ENTRIES] as u16)
    }
}

/// The number of rates that are looked up together.
const RATES_PER_GROUP: usize = 64;

levels! {
    /// Replace `out` with 1 − e⁻ˢ in units of 2⁻¹⁶ for rates s of at least 0.
    fn one_photon(rates: &[f64], out: &mut [u16]) = one_photon_inlined;
    fn look_up(table: &ProbabilityTable, rates: &[f64], out: &mut [u16]) = look_up_inlined;
}

#[inline(always)]
fn one_photon_inlined(rates: &[f64], out: &mut [u16]) {
    // The Taylor series of 2ᶠ for |f| ≤ ½.
    const SERIES: [f32; 6] = {
        let mut series = [1.0; 6];
        let mut power = 1;
        while power < series.len() {
            series[power] = series[power - 1] * std::f32::consts::LN_2 / power as f32;
            power += 1;
        }
        series
    };
    for (out, &rate) in out.iter_mut().zip(rates) {
        // Beyond this limit, P(b = 1) is 1 in units of 2⁻¹⁶.
        let rate = if rate < 20.0 { rate as f32 } else { 20.0 };
        let exponent = rate * std::f32::consts::LOG2_E;
        let (whole, shift) = exponent.nearest();
        let f = whole - exponent;
        let [a, b, c, d, e, g] = SERIES;
        let fraction = a + f * (b + f * (c + f * (d + f * (e + f * g))));
        let power = f32::from_bits((143 - shift) << 23);
        let probability = 65536.0 - fraction * power;
        let probability = if probability < 65535.0 {
            probability
        } else {
            65535.0
        };
        *out = probability.nearest().1 as u16;
    }
}

#[inline(always)]
fn look_up_inlined(table: &ProbabilityTable, rates: &[f64], out: &mut [u16]) {
    let Some(entries) = table.entries.first_chunk() else {
        return;
    };
    let (groups, rest) = rates.as_chunks::<RATES_PER_GROUP>();
    let (out_groups, out_rest) = out.as_chunks_mut::<RATES_PER_GROUP>();
    for (rates, out) in groups.iter().zip(out_groups) {
        *out = table.look_up_group(entries, rates);
    }
    let mut group = [0.0; RATES_PER_GROUP];
    group[..rest.len()].copy_from_slice(rest);
    out_rest.copy_from_slice(&table.look_up_group(entries, &group)[..rest.len()]);
}

/// Return P(b = 1) in units of 2⁻⁴⁸.
pub(super) fn exact_probability(threshold: &Threshold, rate: f64) -> u64 {
    (threshold.detection_probability(rate) * 48f64.exp2()).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    #[test]
    fn the_error_of_the_table_is_within_the_margin() -> Result<()> {
        for q in [1, 2, 5, 26, 40, 3000, Threshold::MAX_PHOTONS] {
            let threshold = Threshold::new(q)?;
            let step = 0.000_173 * f64::from(q + 100);
            let mut rates: Vec<f64> = (0..20_000).map(|k| f64::from(k) * step).collect();
            let fine_step = 0.001 * f64::from(q).sqrt();
            let near_q = (-8000..8000).map(|k| f64::from(q) + f64::from(k) * fine_step);
            rates.extend(near_q.filter(|&rate| rate > 0.0));
            rates.extend([0.0, 1e-300, 1e4, 1e300, f64::INFINITY]);
            let mut probabilities = Vec::new();
            let table = ProbabilityTable::shared(threshold);
            table.look_up(&rates, &mut probabilities);
            for (rate, probability) in rates.iter().zip(probabilities) {
                let exact = 65536.0 * threshold.detection_probability(*rate);
                // One unit of the margin belongs to the draw, which is rounded to 16 bits.
                let error = (f64::from(probability) - exact).abs();
                assert!(
                    error <= f64::from(table.margin - 1),
                    "q = {q}, s = {rate}: {error}"
                );
            }
        }
        Ok(())
    }
}
