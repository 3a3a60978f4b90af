//! The bits of a part of a row of jots.

use super::compare::{Draws, compare, reverse};
use super::exposure::{Exposure, RowRates};
use super::interleave::interleave;
use super::probability_table::{ProbabilityTable, exact_probability};
use crate::cpu::levels;
use crate::likelihood::Threshold;
use crate::rng::{ALIGNMENT, JotRandom, MAX_REFINEMENTS, REFINEMENT_BITS, RowStream};

/// The random numbers and the buffers of a thread, which draws rows in segments.
///
/// A jot reports b = [U < P(b = 1)], where U is a uniform random number of 48 bits. The first 8 bits
/// of U decide nearly all comparisons. The other 40 bits are drawn only where they do not.
pub(super) struct RowSampler<'t> {
    random: JotRandom,
    table: &'t ProbabilityTable,
    /// The jots of the segment, and where it begins among the draws.
    columns: std::ops::Range<usize>,
    offset: usize,
    rates: RowRates,
    /// P(b = 1) of each rate, in units of 2⁻¹⁶.
    probabilities: Vec<u16>,
    /// The bounds of each rate.
    bounds: [Vec<u8>; 2],
    /// The bounds of each jot of whole pixels.
    jot_bounds: Vec<u8>,
    /// The bounds of each draw.
    draw_bounds: [Vec<[u8; 64]>; 2],
    draws: Vec<[u8; ALIGNMENT]>,
    words: Vec<u64>,
    undecided: Vec<u64>,
    /// The jots whose draws the bounds do not decide, counted from the first draw.
    close: Vec<usize>,
}

impl<'t> RowSampler<'t> {
    pub fn new(seed: [u8; 32], table: &'t ProbabilityTable) -> Self {
        Self {
            random: JotRandom::new(seed),
            table,
            columns: 0..0,
            offset: 0,
            rates: RowRates::default(),
            probabilities: Vec::new(),
            bounds: [Vec::new(), Vec::new()],
            jot_bounds: Vec::new(),
            draw_bounds: [Vec::new(), Vec::new()],
            draws: Vec::new(),
            words: Vec::new(),
            undecided: Vec::new(),
            close: Vec::new(),
        }
    }

    /// Choose the segment that is drawn next, and compute its probabilities.
    pub fn select(
        &mut self,
        exposure: &Exposure<'_, '_, '_>,
        row: usize,
        columns: std::ops::Range<usize>,
    ) {
        exposure.row_rates(row, columns.clone(), &mut self.rates);
        self.table
            .look_up(&self.rates.values, &mut self.probabilities);
        for bounds in &mut self.bounds {
            bounds.resize(self.probabilities.len(), 0);
        }
        let [lower, upper] = &mut self.bounds;
        bound(self.table, &self.probabilities, lower, upper);

        self.offset = columns.start % ALIGNMENT;
        let end = self.offset + columns.len();
        self.draws.resize(end.div_ceil(ALIGNMENT), [0; ALIGNMENT]);
        self.words.resize(end.div_ceil(64), 0);
        self.undecided.resize(self.words.len(), 0);
        let RowRates {
            pixels,
            period,
            phase,
            ..
        } = self.rates;
        self.jot_bounds.resize(pixels * period, 0);
        for (bounds, draw_bounds) in self.bounds.iter().zip(&mut self.draw_bounds) {
            interleave(pixels, bounds, period, &mut self.jot_bounds);
            draw_bounds.resize(self.words.len(), [0; 64]);
            draw_bounds.as_flattened_mut()[self.offset..end]
                .copy_from_slice(&self.jot_bounds[phase..phase + columns.len()]);
        }
        self.columns = columns;
    }

    /// Draw the bits of the segment, and return words with the bit of the first jot. The most
    /// significant bit of a word is its first jot.
    pub fn draw(&mut self, stream: RowStream, threshold: &Threshold) -> (&[u64], usize) {
        let first = self.columns.start - self.offset;
        self.random.fill_draws(stream, first, &mut self.draws);
        let draws = Draws {
            values: self.draws.as_flattened().as_chunks().0,
            lower: &self.draw_bounds[0],
            upper: &self.draw_bounds[1],
        };
        compare(draws, &mut self.words, &mut self.undecided);
        self.refine(stream, threshold);
        reverse(&mut self.words);
        (&self.words, self.offset)
    }

    /// Decide the bits that the bounds do not decide.
    fn refine(&mut self, stream: RowStream, threshold: &Threshold) {
        let drawn = self.offset..self.offset + self.columns.len();
        self.close.clear();
        for (index, &word) in self.undecided.iter().enumerate() {
            let mut rest = word;
            while rest != 0 {
                let place = 64 * index + rest.trailing_zeros() as usize;
                // The draws before and after the segment have no bounds.
                if drawn.contains(&place) {
                    self.close.push(place);
                }
                rest &= rest - 1;
            }
        }
        let first = self.columns.start - self.offset;
        for places in self.close.chunks(MAX_REFINEMENTS) {
            let mut columns = [0; MAX_REFINEMENTS];
            for (column, place) in columns.iter_mut().zip(places) {
                *column = first + place;
            }
            let refinements = self.random.refinements(stream, &columns[..places.len()]);
            for (&place, refinement) in places.iter().zip(refinements) {
                let draw = u64::from(self.draws.as_flattened()[place]);
                let draw = draw << REFINEMENT_BITS | refinement;
                let rate = self.rates.index(place - self.offset);
                let close_to = self.probabilities[rate];
                let is_one = match self.table.compare(draw, close_to) {
                    Some(is_one) => is_one,
                    None => draw < exact_probability(threshold, self.rates.values[rate]),
                };
                self.words[place / 64] |= u64::from(is_one) << (place % 64);
            }
        }
    }
}

levels! {
    /// Write the bounds of draws of 8 bits: below the lower one, U is below P(b = 1), and above the
    /// upper one, U is at least P(b = 1).
    fn bound(
        table: &ProbabilityTable, probabilities: &[u16], lower: &mut [u8], upper: &mut [u8],
    ) = bound_inlined;
}

#[inline(always)]
fn bound_inlined(
    table: &ProbabilityTable,
    probabilities: &[u16],
    lower: &mut [u8],
    upper: &mut [u8],
) {
    for ((&probability, lower), upper) in probabilities.iter().zip(lower).zip(upper) {
        let (low, high) = table.interval(probability);
        *lower = (low >> 8) as u8;
        *upper = (high >> 8) as u8;
    }
}
