//! The likelihood of what was seen, ℓ(s) = Σ L log P(q, η s + d) + (n − L) log(1 − P(q, η s + d)): its value, gradient and
//! curvature, and the proximal map of −ℓ. L of n bits are 1; a cell is a jot, or a pixel whose jots all see the same light.

mod one_photon;
mod threshold;

use rayon::prelude::*;

use crate::error::{Error, Result};

pub use threshold::Threshold;

/// Cells that a thread works on at a time; sums are taken in this order for any number of threads.
const STRETCH: usize = 1 << 12;

/// At a rate of 0 some slopes are limits that the formulas do not give; this rate stands for it.
const DARKEST: f64 = 1e-150;

/// One value for all cells, or one for each.
#[derive(Clone, Copy, Debug)]
pub enum Values<'a, T> {
    /// The same for all.
    Same(T),
    /// One for each cell, in order.
    Each(&'a [T]),
}

impl<T: Copy> Values<'_, T> {
    pub(crate) fn at(&self, index: usize) -> T {
        match self {
            Self::Same(value) => *value,
            Self::Each(values) => values[index],
        }
    }

    pub(crate) fn check(&self, what: &'static str, length: usize) -> Result<()> {
        match self {
            Self::Each(values) if values.len() != length => {
                Err(Error::shape(what, length, values.len()))
            }
            _ => Ok(()),
        }
    }
}

/// Refuses counts that are below 0 or above the valid bits.
pub(crate) fn check_counts(counts: &[i32], trials: Values<'_, i32>) -> Result<()> {
    for (index, &ones) in counts.iter().enumerate() {
        if ones < 0 || ones > trials.at(index) {
            return Err(Error::shape(
                "counts",
                format!("0 to {}", trials.at(index)),
                ones,
            ));
        }
    }
    Ok(())
}

/// How a step of ADMM is made.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// ρ, of the penalty ½ ρ ‖A c − x + dual‖².
    pub penalty: f64,
    /// 1 for none; above 1 the step goes further than A c.
    pub relaxation: f64,
}

impl Step {
    pub(crate) fn relaxed(&self, there: f64, x: f64) -> f64 {
        self.relaxation * there + (1.0 - self.relaxation) * x
    }
}

/// What a sensor saw: L ones out of n valid bits of each cell, which detects the share η of its light and fires d times without.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    threshold: Threshold,
    ones: &'a [i32],
    trials: Values<'a, i32>,
    efficiency: Values<'a, f64>,
    dark: Values<'a, f64>,
}

/// What one cell saw.
#[derive(Clone, Copy, Debug)]
struct Cell {
    ones: f64,
    zeros: f64,
    efficiency: f64,
    dark: f64,
}

/// What the cells of a stretch saw.
#[derive(Default)]
struct Cells {
    ones: Vec<f64>,
    zeros: Vec<f64>,
    efficiency: Vec<f64>,
    dark: Vec<f64>,
}

impl Cells {
    fn at(&self, index: usize) -> Cell {
        Cell {
            ones: self.ones[index],
            zeros: self.zeros[index],
            efficiency: self.efficiency[index],
            dark: self.dark[index],
        }
    }
}

/// How a proximal map is found: the penalty ρ, the upper bound of x, and the last step as a share of the root.
#[derive(Clone, Copy)]
struct Search {
    penalty: f64,
    most: f64,
    tolerance: f64,
}

impl<'a> Seen<'a> {
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit, or a count is above the valid bits.
    pub fn new(
        threshold: Threshold,
        ones: &'a [i32],
        trials: Values<'a, i32>,
        efficiency: Values<'a, f64>,
        dark: Values<'a, f64>,
    ) -> Result<Self> {
        trials.check("trials", ones.len())?;
        efficiency.check("efficiency", ones.len())?;
        dark.check("dark counts", ones.len())?;
        check_counts(ones, trials)?;
        Ok(Self {
            threshold,
            ones,
            trials,
            efficiency,
            dark,
        })
    }

    /// How many cells there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ones.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ones.is_empty()
    }

    fn cell(&self, index: usize) -> Cell {
        let ones = self.ones[index];
        Cell {
            ones: f64::from(ones),
            zeros: f64::from(self.trials.at(index) - ones),
            efficiency: self.efficiency.at(index),
            dark: self.dark.at(index),
        }
    }

    /// The cells of a stretch, into `cells`.
    fn gather(&self, stretch: usize, cells: &mut Cells) {
        let first = stretch * STRETCH;
        let last = (first + STRETCH).min(self.len());
        cells.ones.clear();
        cells.zeros.clear();
        let ones = &self.ones[first..last];
        cells.ones.extend(ones.iter().map(|&ones| f64::from(ones)));
        match self.trials {
            Values::Same(trials) => cells
                .zeros
                .extend(ones.iter().map(|ones| f64::from(trials - ones))),
            Values::Each(trials) => cells.zeros.extend(
                ones.iter()
                    .zip(&trials[first..last])
                    .map(|(ones, trials)| f64::from(trials - ones)),
            ),
        }
        for (values, cells) in [
            (self.efficiency, &mut cells.efficiency),
            (self.dark, &mut cells.dark),
        ] {
            cells.clear();
            match values {
                Values::Same(value) => cells.resize(ones.len(), value),
                Values::Each(values) => cells.extend_from_slice(&values[first..last]),
            }
        }
    }

    /// ℓ at the light s of each cell: −∞ where a bit is 1 that cannot be.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit.
    pub fn value(&self, light: &[f64]) -> Result<f64> {
        self.check(light.len())?;
        let sums: Vec<f64> = light
            .par_chunks(STRETCH)
            .enumerate()
            .map(|(stretch, light)| {
                light
                    .iter()
                    .zip(stretch * STRETCH..)
                    .map(|(&light, index)| self.log_probability(self.cell(index), light))
                    .sum()
            })
            .collect();
        Ok(sums.iter().sum())
    }

    /// ∇ℓ and the curvature −∂²ℓ/∂s² ≥ 0 of each cell, into `gradient` and `curvature`.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit.
    pub fn slopes(&self, light: &[f64], gradient: &mut [f64], curvature: &mut [f64]) -> Result<()> {
        self.check(light.len())?;
        self.check(gradient.len())?;
        self.check(curvature.len())?;
        gradient
            .par_chunks_mut(STRETCH)
            .zip(curvature.par_chunks_mut(STRETCH))
            .zip(light.par_chunks(STRETCH))
            .enumerate()
            .for_each_init(
                Cells::default,
                |cells, (stretch, ((gradient, curvature), light))| {
                    self.gather(stretch, cells);
                    if self.threshold.photons() == 1 {
                        return one_photon::slopes(cells, light, gradient, curvature);
                    }
                    for (index, &light) in light.iter().enumerate() {
                        (gradient[index], curvature[index]) =
                            self.slopes_at(cells.at(index), light);
                    }
                },
            );
        Ok(())
    }

    /// The Fisher information about the light, n (η P')² / (P (1 − P)), that the bits of each cell carry on average, into
    /// `information`.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit.
    pub fn information(&self, light: &[f64], information: &mut [f64]) -> Result<()> {
        self.check(light.len())?;
        self.check(information.len())?;
        information.par_iter_mut().zip(light).enumerate().for_each(
            |(index, (information, &light))| {
                let efficiency = self.efficiency.at(index);
                let rate = (efficiency * light + self.dark.at(index)).max(DARKEST);
                *information = f64::from(self.trials.at(index))
                    * efficiency
                    * efficiency
                    * self.threshold.fired_slopes(rate).0
                    * self.threshold.dark_slopes(rate).0;
            },
        );
        Ok(())
    }

    /// The proximal map of −ℓ, cell by cell: the minimum in [0, `most`] of −ℓ(x) + ½ `penalty` (x − point)². Each `point` is replaced
    /// by it; `guess` is where its search begins.
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] for a penalty that is not above 0.
    pub fn proximal(
        &self,
        penalty: f64,
        most: f64,
        guess: &[f64],
        point: &mut [f64],
    ) -> Result<()> {
        self.check(point.len())?;
        self.check(guess.len())?;
        check_penalty(penalty)?;
        let search = Search {
            penalty,
            most,
            tolerance: TOLERANCE,
        };
        point
            .par_chunks_mut(STRETCH)
            .zip(guess.par_chunks(STRETCH))
            .enumerate()
            .for_each_init(Cells::default, |cells, (stretch, (point, guess))| {
                self.gather(stretch, cells);
                self.search(cells, search, guess, point);
            });
        Ok(())
    }

    /// One step of ADMM on −ℓ: with x split off from the light of an image, the over-relaxed `light` plus the dual goes to the
    /// proximal map, which gives x; what is left is the new dual. Gives ‖light − x‖².
    ///
    /// # Errors
    /// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] for a penalty that is not above 0.
    pub fn split(
        &self,
        step: &Step,
        most: f64,
        light: &[f64],
        x: &mut [f64],
        dual: &mut [f64],
    ) -> Result<f64> {
        self.check(light.len())?;
        self.check(x.len())?;
        self.check(dual.len())?;
        check_penalty(step.penalty)?;
        let search = Search {
            penalty: step.penalty,
            most,
            tolerance: SPLIT_TOLERANCE,
        };
        let sums: Vec<f64> = x
            .par_chunks_mut(STRETCH)
            .zip(dual.par_chunks_mut(STRETCH))
            .zip(light.par_chunks(STRETCH))
            .enumerate()
            .map_init(
                || (Cells::default(), Vec::new()),
                |(cells, point), (stretch, ((x, dual), light))| {
                    self.gather(stretch, cells);
                    for ((x, dual), &light) in x.iter().zip(dual.iter_mut()).zip(light) {
                        *dual += step.relaxed(light, *x);
                    }
                    point.clear();
                    point.extend_from_slice(dual);
                    self.search(cells, search, x, point);
                    let mut sum = 0.0;
                    for (((x, dual), &light), &new) in
                        x.iter_mut().zip(dual).zip(light).zip(point.iter())
                    {
                        *x = new;
                        *dual -= new;
                        sum += (light - new) * (light - new);
                    }
                    sum
                },
            )
            .collect();
        Ok(sums.iter().sum())
    }

    fn search(&self, cells: &Cells, search: Search, guess: &[f64], point: &mut [f64]) {
        if self.threshold.photons() == 1 {
            return one_photon::nearest(
                cells,
                (search.penalty, search.most, search.tolerance),
                guess,
                point,
            );
        }
        for (index, (point, &guess)) in point.iter_mut().zip(guess).enumerate() {
            *point = self.nearest(cells.at(index), search, *point, guess);
        }
    }

    fn check(&self, length: usize) -> Result<()> {
        if length == self.len() {
            Ok(())
        } else {
            Err(Error::shape("light", self.len(), length))
        }
    }

    fn log_probability(&self, cell: Cell, light: f64) -> f64 {
        let rate = cell.efficiency * light + cell.dark;
        // 0 · log 0 is 0 here: what was never seen says nothing.
        let mut value = 0.0;
        if cell.ones > 0.0 {
            value += cell.ones * self.threshold.log_fires(rate);
        }
        if cell.zeros > 0.0 {
            value += cell.zeros * self.threshold.log_stays_dark(rate);
        }
        value
    }

    #[inline]
    fn slopes_at(&self, cell: Cell, light: f64) -> (f64, f64) {
        let rate = (cell.efficiency * light + cell.dark).max(DARKEST);
        let (mut gradient, mut curvature) = (0.0, 0.0);
        if cell.ones > 0.0 {
            let (score, bend) = self.threshold.fired_slopes(rate);
            gradient += cell.ones * score;
            curvature += cell.ones * bend;
        }
        if cell.zeros > 0.0 {
            let (score, bend) = self.threshold.dark_slopes(rate);
            gradient -= cell.zeros * score;
            curvature += cell.zeros * bend;
        }
        (
            cell.efficiency * gradient,
            cell.efficiency * cell.efficiency * curvature,
        )
    }

    /// Newton's method on the slope of −ℓ(x) + ½ penalty (x − point)², which rises, between bounds that close in on the root.
    fn nearest(&self, cell: Cell, search: Search, point: f64, guess: f64) -> f64 {
        let Search {
            penalty,
            most,
            tolerance,
        } = search;
        if cell.ones + cell.zeros <= 0.0 {
            return point.clamp(0.0, most);
        }
        let slopes = |x: f64| {
            let (gradient, curvature) = self.slopes_at(cell, x);
            (penalty * (x - point) - gradient, penalty + curvature)
        };
        let (mut low, mut high) = (0.0, most);
        // Whether the root is known to lie on this side of the end.
        let (mut above_0, mut below_most) = (false, false);
        let mut x = first_try(guess, most);
        for _ in 0..ROUNDS {
            let (slope, bend) = slopes(x);
            if slope > 0.0 {
                (high, below_most) = (x, true);
            } else {
                (low, above_0) = (x, true);
            }
            let mut next = x - slope / bend;
            if next >= high && !below_most {
                if slopes(most).0 <= 0.0 {
                    return most;
                }
                below_most = true;
            } else if next <= low && !above_0 {
                if slopes(0.0).0 >= 0.0 {
                    return 0.0;
                }
                above_0 = true;
            }
            let newton = next > low && next < high || next.to_bits() == x.to_bits();
            if !newton {
                next = 0.5 * (low + high);
            }
            let near = (next - x).abs() <= tolerance * next;
            if near && newton || high - low <= f64::EPSILON * high {
                return next;
            }
            x = next;
        }
        x
    }
}

/// Where a search begins: at the guess, but not where the slope is so steep that Newton's steps would double x for ever.
#[inline(always)]
fn first_try(guess: f64, most: f64) -> f64 {
    if guess < most {
        guess.max(1e-9 * most)
    } else {
        0.5 * most
    }
}

/// For the proximal map by itself: some 1e-10 is left.
const TOLERANCE: f64 = 1e-5;

/// Inside of ADMM, where x moves less and less and with it the square of its last step: what is left is far below that move.
const SPLIT_TOLERANCE: f64 = 1e-3;

/// Newton's steps and halvings at most; from any start halvings alone would do.
const ROUNDS: usize = 200;

pub(crate) fn check_penalty(penalty: f64) -> Result<()> {
    if penalty > 0.0 && penalty.is_finite() {
        Ok(())
    } else {
        Err(Error::range("penalty", "a finite number above 0", penalty))
    }
}
