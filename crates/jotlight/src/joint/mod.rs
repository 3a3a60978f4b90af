//! Maximum likelihood of readings with different gains and thresholds, pixel by pixel.
//!
//! The readings of a pixel form terms with one gain and one threshold each. Their likelihoods are
//! functions of the same intensity x, and their sum is concave. Newton's method solves for the zero
//! of its derivative about v = log(x + δ), where δ is the intensity whose detections equal the dark
//! counts: without dark counts, the log-likelihood is concave in v too, and nearly quadratic. Steps
//! that leave the known bounds of the root are replaced by a bisection of v.

mod tables;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::interrupt;
use crate::likelihood::Readings;
use crate::multibit::{Cells, RateTable, Response, ScoreTable};
use crate::values::{check_not_negative, check_numbers, check_positive};
use tables::{Tabulated, with_tables};

/// The maximum number of steps of Newton's method with bisection. Most pixels need less than ten.
const MAX_STEPS: usize = 200;

/// The relative change of the intensity at which the iteration stops. The next step would be about
/// its square.
const TOLERANCE: f64 = 1e-9;

/// The number of steps from which a search is unusual.
const USUAL_STEPS: usize = 8;

/// The smallest ratio of the bounds between which a bisection takes place. Smaller values are rare.
const MAX_RATIO: f64 = 1e-6;

/// The number of pixels of a task.
const PIXELS_PER_TASK: usize = 256;

/// The readings of the cells of a term.
#[derive(Clone, Copy, Debug)]
pub enum TermCells<'a> {
    /// Bits without read noise.
    Bits(Readings<'a>),
    /// Readings of several bits, or bits with read noise.
    Several(Cells<'a>),
}

impl TermCells<'_> {
    fn len(&self) -> usize {
        match self {
            Self::Bits(readings) => readings.len(),
            Self::Several(cells) => cells.len(),
        }
    }
}

/// The readings with one gain and one threshold.
#[derive(Clone, Copy, Debug)]
pub struct Term<'a> {
    /// The cells: pixels, or squares of `side` × `side` jots for each pixel.
    pub cells: TermCells<'a>,
    /// The light of a jot per frame at intensity 1.
    pub light: f64,
    /// The number of cells per pixel and dimension.
    pub side: usize,
    /// The index of each cell of the image among the cells, −1 for one without readings. `None`: all
    /// cells have readings.
    pub places: Option<&'a [i32]>,
}

/// The readings of all pixels of an image.
#[derive(Clone, Debug)]
pub struct JointReadings<'a> {
    terms: Vec<Term<'a>>,
    width: usize,
    pixels: usize,
}

impl<'a> JointReadings<'a> {
    /// Return the readings of an image of `height` × `width` pixels.
    ///
    /// # Errors
    /// [`Error::Shape`] if a term has another number of cells. [`Error::Range`] for a cell index
    /// beyond the cells, and for light that is infinite, NaN, or negative.
    pub fn new(terms: Vec<Term<'a>>, height: usize, width: usize) -> Result<Self> {
        let pixels = height.saturating_mul(width);
        for term in &terms {
            // Slices are shorter than the largest number.
            let cells = [term.side; 2]
                .into_iter()
                .fold(pixels, usize::saturating_mul);
            let given = term.places.map_or(term.cells.len(), <[i32]>::len);
            if given != cells {
                return Err(Error::shape("cells", cells, given));
            }
            check_not_negative("light", &[term.light])?;
            let number = term.cells.len();
            let beyond = |&&place: &&i32| place >= 0 && place as usize >= number;
            if let Some(place) = term.places.and_then(|places| places.iter().find(beyond)) {
                return Err(Error::range("places", format!("less than {number}"), place));
            }
        }
        Ok(Self {
            terms,
            width,
            pixels,
        })
    }

    /// Replace `intensity`, the first guess, with the intensities in [0, `highest`] at which the
    /// likelihood is highest. `offset` is δ.
    ///
    /// # Errors
    /// [`Error::Shape`] for another number of intensities. [`Error::Range`] if `highest` is not a
    /// finite number above 0, or `offset` is infinite, NaN, or negative.
    pub fn maximize(&self, highest: f64, offset: f64, intensity: &mut [f64]) -> Result<()> {
        check_search(highest, offset)?;
        let cells = with_tables(&self.terms, ScoreTable::new);
        self.for_each_pixel(intensity, |pixel, start| {
            let derivatives = |x: f64| {
                let (gradient, curvature) = self.derivatives(pixel, x, &cells);
                (gradient, (x + offset) * curvature - gradient)
            };
            find_root(derivatives, start, highest, offset)
        })
    }

    /// Replace `intensity`, the first guess, with the intensities in [0, `highest`] at which the
    /// expected sum of the readings is `total`. `offset` is δ. For a total of 0 or less, it is 0.
    ///
    /// # Errors
    /// [`Error::Shape`] for another number of intensities or totals. [`Error::Range`] if `highest` is
    /// not a finite number above 0, `offset` is infinite, NaN, or negative, or a total is NaN.
    pub fn solve_total(
        &self,
        total: &[f64],
        highest: f64,
        offset: f64,
        intensity: &mut [f64],
    ) -> Result<()> {
        if total.len() != self.pixels {
            return Err(Error::shape("total", self.pixels, total.len()));
        }
        check_search(highest, offset)?;
        check_numbers("total", total)?;
        let cells = with_tables(&self.terms, Response::moments_table);
        self.for_each_pixel(intensity, |pixel, start| {
            // Expected sums that underflow would be as near to 0 as that of darkness.
            if total[pixel] <= 0.0 {
                return 0.0;
            }
            let evaluate = |x: f64| {
                let (expected, slope) = self.expected_total(pixel, x, &cells);
                (total[pixel] - expected, (x + offset) * slope)
            };
            find_root(evaluate, start, highest, offset)
        })
    }

    fn for_each_pixel(
        &self,
        intensity: &mut [f64],
        solve: impl Fn(usize, f64) -> f64 + Sync,
    ) -> Result<()> {
        if intensity.len() != self.pixels {
            return Err(Error::shape("intensity", self.pixels, intensity.len()));
        }
        intensity
            .par_chunks_mut(PIXELS_PER_TASK)
            .enumerate()
            .for_each(|(task, intensity)| {
                for (x, pixel) in intensity.iter_mut().zip(task * PIXELS_PER_TASK..) {
                    if interrupt::is_requested() {
                        return;
                    }
                    *x = solve(pixel, *x);
                }
            });
        Ok(())
    }

    /// Return the derivative of the log-likelihood of a pixel, and minus the second one. `cells` belong
    /// to the terms.
    fn derivatives(
        &self,
        pixel: usize,
        intensity: f64,
        cells: &[Tabulated<'_, ScoreTable<'_>>],
    ) -> (f64, f64) {
        let (mut gradient, mut curvature) = (0.0, 0.0);
        for (term, cells) in self.terms.iter().zip(cells) {
            let light = term.light * intensity;
            let (mut first, mut second) = (0.0, 0.0);
            self.for_each_cell(term, pixel, |cell| {
                let (one, two) = match cells {
                    Tabulated::Bits(readings) => readings.derivatives(cell, light),
                    Tabulated::Several(cells, scores) => cells.derivatives(cell, light, scores),
                };
                first += one;
                second += two;
            });
            gradient += term.light * first;
            curvature += term.light * term.light * second;
        }
        (gradient, curvature)
    }

    /// Return the expected sum of the readings of a pixel, and its derivative. `cells` belong to the
    /// terms.
    fn expected_total<F: Fn(f64) -> [f64; 3] + Sync>(
        &self,
        pixel: usize,
        intensity: f64,
        cells: &[Tabulated<'_, RateTable<F, 3>>],
    ) -> (f64, f64) {
        let (mut total, mut slope) = (0.0, 0.0);
        for (term, cells) in self.terms.iter().zip(cells) {
            let light = term.light * intensity;
            self.for_each_cell(term, pixel, |cell| {
                let (one, two) = match cells {
                    Tabulated::Bits(readings) => readings.expected_ones(cell, light),
                    Tabulated::Several(cells, moments) => {
                        cells.expected_total(cell, light, moments)
                    }
                };
                total += one;
                slope += term.light * two;
            });
        }
        (total, slope)
    }

    /// Call a function with each cell of a pixel that has readings.
    fn for_each_cell(&self, term: &Term<'_>, pixel: usize, mut function: impl FnMut(usize)) {
        let (row, column) = (pixel / self.width, pixel % self.width);
        for down in 0..term.side {
            let first = ((row * term.side + down) * self.width + column) * term.side;
            for cell in first..first + term.side {
                match term.places {
                    None => function(cell),
                    Some(places) => {
                        if let Ok(place) = usize::try_from(places[cell]) {
                            function(place);
                        }
                    }
                }
            }
        }
    }
}

/// Check the bound and the offset of the intensities.
fn check_search(highest: f64, offset: f64) -> Result<()> {
    check_positive("highest intensity", highest)?;
    check_not_negative("offset", &[offset])
}

/// Return the zero of a falling function in [0, `highest`], or the end of this range that is nearest
/// to it.
///
/// `evaluate` returns the function and minus its derivative about v. Most searches stay inside of
/// the range, so the function is evaluated at its ends only when a search is unusual.
fn find_root(evaluate: impl Fn(f64) -> (f64, f64), start: f64, highest: f64, offset: f64) -> f64 {
    let (mut low, mut high) = (0.0f64, highest);
    let (mut is_low_tested, mut is_high_tested) = (false, false);
    let mut x = start.clamp(0.0, highest);
    let usual = 0.5 * (x + offset)..2.0 * (x + offset);
    for step in 0..MAX_STEPS {
        let (value, slope) = evaluate(x);
        if value > 0.0 {
            (low, is_low_tested) = (x, true);
        }
        if value < 0.0 {
            (high, is_high_tested) = (x, true);
        }
        let scale = x + offset;
        let newton = scale * (value / slope).exp() - offset;
        let is_inside = slope > 0.0 && low < newton && newton < high;
        if !is_inside || !usual.contains(&(newton + offset)) || step >= USUAL_STEPS {
            if !is_low_tested && evaluate(0.0).0 <= 0.0 {
                return 0.0;
            }
            if !is_high_tested && evaluate(highest).0 >= 0.0 {
                return highest;
            }
            (is_low_tested, is_high_tested) = (true, true);
        }
        // Rounding can move a last tiny step across a bound, where bisection would undo it.
        if slope > 0.0 && (newton - x).abs() <= TOLERANCE * scale {
            return newton.clamp(low, high);
        }
        let bound = low.max(MAX_RATIO * high);
        let middle = ((bound + offset) * (high + offset)).sqrt() - offset;
        x = if is_inside { newton } else { middle };
        if high - low <= TOLERANCE * scale {
            return x;
        }
    }
    x
}

#[cfg(test)]
mod tests;
