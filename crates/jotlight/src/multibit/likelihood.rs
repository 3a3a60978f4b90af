//! The log-likelihood of readings of several bits, its derivatives, and the Fisher information.

use super::{RateTable, Response, ScoreTable};
use crate::elements;
use crate::error::{Error, Result, check_shape};
use crate::values::Values;

/// The number of cells per task. Each task has its own sum, so that results are the same for any
/// number of threads.
const CELLS_PER_TASK: usize = 256;

/// The readings of all cells, with the same number of entries for each.
#[derive(Clone, Copy, Debug)]
pub enum Sample<'a> {
    /// How often each reading 0, 1, … occurs.
    Histograms(&'a [i32]),
    /// The readings themselves. Negative numbers are left out.
    Readings(&'a [i32]),
}

/// The readings and the response of cells: of jots, or of pixels whose jots are alike.
#[derive(Clone, Copy, Debug)]
pub struct Cells<'a> {
    response: &'a Response,
    sample: Sample<'a>,
    number: usize,
    entries: usize,
    efficiency: Values<'a, f64>,
    dark_counts: Values<'a, f64>,
}

impl<'a> Cells<'a> {
    /// Return `number` cells with their sample, η = `efficiency`, and d = `dark_counts`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths do not match. [`Error::Range`] for a reading above the
    /// highest one, a negative number in a histogram, and for an efficiency or dark counts that are
    /// infinite, NaN, or negative.
    pub fn new(
        response: &'a Response,
        sample: Sample<'a>,
        number: usize,
        efficiency: Values<'a, f64>,
        dark_counts: Values<'a, f64>,
    ) -> Result<Self> {
        efficiency.check("efficiency", number)?;
        dark_counts.check("dark counts", number)?;
        let (values, top) = match sample {
            Sample::Histograms(values) => (values, i32::MAX),
            Sample::Readings(values) => (values, response.max_reading() as i32),
        };
        // Without cells, there are no entries.
        let entries = values.len().checked_div(number).unwrap_or(0);
        if entries * number != values.len() {
            let expected = format_args!("a multiple of {number}, the number of cells");
            return Err(Error::shape("sample", expected, values.len()));
        }
        if let Sample::Histograms(values) = sample {
            if entries > response.max_reading() as usize + 1 {
                let expected = response.max_reading() as usize + 1;
                return Err(Error::shape("histograms", expected, entries));
            }
            if let Some(&negative) = values.iter().find(|&&value| value < 0) {
                return Err(Error::range("histograms", "numbers of 0 or more", negative));
            }
        }
        if let Some(&high) = values.iter().find(|&&value| value > top) {
            return Err(Error::range("readings", format!("at most {top}"), high));
        }
        Ok(Self {
            response,
            sample,
            number,
            entries,
            efficiency,
            dark_counts,
        })
    }

    /// Return the number of cells.
    #[must_use]
    pub fn len(&self) -> usize {
        self.number
    }

    /// Return whether there are no cells.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.number == 0
    }

    /// Return the log-likelihood, where `light` is the light of each cell.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths do not match.
    pub fn value(&self, light: &[f64]) -> Result<f64> {
        check_shape("light", self.number, light.len())?;
        Ok(elements::sum(self.number, CELLS_PER_TASK, |cell| {
            let rate = self.rate(cell, light[cell]);
            let mut sum = 0.0;
            self.for_each(cell, |reading, number| {
                sum += number * self.response.ln_probability(reading, rate);
            });
            sum
        }))
    }

    /// Write the derivative of each cell about its light, and minus the second one.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths do not match.
    pub fn gradient_and_curvature(
        &self,
        light: &[f64],
        gradient: &mut [f64],
        curvature: &mut [f64],
    ) -> Result<()> {
        check_shape("light", self.number, light.len())?;
        check_shape("gradient", self.number, gradient.len())?;
        check_shape("curvature", self.number, curvature.len())?;
        let scores = ScoreTable::new(self.response);
        let write = |(): &mut (), first, gradient: &mut [f64], curvature: &mut [f64]| {
            for (cell, out) in (first..).zip(gradient.iter_mut().zip(curvature)) {
                (*out.0, *out.1) = self.derivatives(cell, light[cell], &scores);
            }
        };
        elements::write_pairs(gradient, curvature, CELLS_PER_TASK, || (), write);
        Ok(())
    }

    /// Return the derivative of one cell about its light, and minus the second one. `scores` are
    /// those of its response.
    ///
    /// # Panics
    /// If there are fewer cells.
    #[must_use]
    pub fn derivatives(&self, cell: usize, light: f64, scores: &ScoreTable<'_>) -> (f64, f64) {
        let efficiency = self.efficiency.get(cell);
        let score_and_curvature = scores.at(self.rate(cell, light));
        let (mut first, mut second) = (0.0, 0.0);
        self.for_each(cell, |reading, number| {
            let (score, curvature) = score_and_curvature(reading);
            first += number * score;
            second += number * curvature;
        });
        (efficiency * first, efficiency * efficiency * second)
    }

    /// Return the expected sum of the readings of one cell, and its derivative about the light.
    /// `moments` is the table of their response.
    ///
    /// # Panics
    /// If there are fewer cells.
    #[must_use]
    pub fn expected_total<F: Fn(f64) -> [f64; 3] + Sync>(
        &self,
        cell: usize,
        light: f64,
        moments: &RateTable<F, 3>,
    ) -> (f64, f64) {
        let mut number = 0.0;
        self.for_each(cell, |_, times| number += times);
        let [mean, _, slope] = moments.at(self.rate(cell, light));
        (number * mean, number * self.efficiency.get(cell) * slope)
    }

    /// Return the response of the cells.
    #[must_use]
    pub fn response(&self) -> &'a Response {
        self.response
    }

    /// Call a function with the readings of a cell, and with how often each occurs.
    fn for_each(&self, cell: usize, mut function: impl FnMut(u32, f64)) {
        let entries = cell * self.entries..(cell + 1) * self.entries;
        match self.sample {
            Sample::Histograms(values) => {
                for (reading, &number) in values[entries].iter().enumerate() {
                    if number > 0 {
                        function(reading as u32, f64::from(number));
                    }
                }
            }
            Sample::Readings(values) => {
                for &reading in values[entries].iter().filter(|&&reading| reading >= 0) {
                    function(reading as u32, 1.0);
                }
            }
        }
    }

    fn rate(&self, cell: usize, light: f64) -> f64 {
        self.efficiency.get(cell) * light + self.dark_counts.get(cell)
    }
}
