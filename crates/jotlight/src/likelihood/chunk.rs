//! Chunks of elements. Each thread processes one chunk at a time. A chunk stores one array per
//! property, so that the compiler can vectorize the loops over its elements.

use super::Readings;
use crate::values::Values;

/// The number of elements in a chunk. Each chunk has its own sum, so that results are the same for
/// any number of threads.
pub(super) const ELEMENTS_PER_CHUNK: usize = 1 << 12;

/// The counts and the response of one element.
#[derive(Clone, Copy, Debug)]
pub(super) struct Element {
    pub ones: f64,
    pub zeros: f64,
    pub efficiency: f64,
    pub dark_counts: f64,
}

/// The counts and the responses of all elements of a chunk.
#[derive(Default)]
pub(super) struct Chunk {
    pub ones: Vec<f64>,
    pub zeros: Vec<f64>,
    pub efficiency: Vec<f64>,
    pub dark_counts: Vec<f64>,
}

impl Chunk {
    pub fn element(&self, index: usize) -> Element {
        Element {
            ones: self.ones[index],
            zeros: self.zeros[index],
            efficiency: self.efficiency[index],
            dark_counts: self.dark_counts[index],
        }
    }

    /// Replace the content with chunk number `number` of `readings`.
    pub fn fill(&mut self, readings: &Readings<'_>, number: usize) {
        let first = number * ELEMENTS_PER_CHUNK;
        let last = (first + ELEMENTS_PER_CHUNK).min(readings.len());
        let ones = &readings.ones[first..last];
        self.ones.clear();
        self.ones.extend(ones.iter().map(|&ones| f64::from(ones)));
        self.zeros.clear();
        match readings.trials {
            Values::Same(trials) => self
                .zeros
                .extend(ones.iter().map(|&ones| trials - f64::from(ones))),
            Values::Each(trials) => self.zeros.extend(
                ones.iter()
                    .zip(&trials[first..last])
                    .map(|(&ones, trials)| trials - f64::from(ones)),
            ),
        }
        for (values, column) in [
            (readings.efficiency, &mut self.efficiency),
            (readings.dark_counts, &mut self.dark_counts),
        ] {
            column.clear();
            match values {
                Values::Same(value) => column.resize(ones.len(), value),
                Values::Each(values) => column.extend_from_slice(&values[first..last]),
            }
        }
    }
}
