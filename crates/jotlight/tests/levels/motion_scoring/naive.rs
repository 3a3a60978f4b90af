//! Random cases, and their normal equations and χ² in `f64`, one pixel after the other.

use jotlight::error::Result;
use jotlight::motion::{
    BLOCK, Comparison, Counts, Equations, Sums, TILE, Template, normal_equations,
};
use ndarray::{Array2, Array3};

use crate::random::Random;

/// Counts of a block, and the template to which they are compared.
pub struct Case {
    pub ones: Array2<i32>,
    pub trials: Array2<i32>,
    pub remainders: Array3<f32>,
    pub probability: Array2<f32>,
    pub of_template: Array2<i32>,
}

impl Case {
    pub fn new(rows: usize, columns: usize) -> Self {
        let mut random = Random((rows * 1000 + columns) as u32);
        let mut integers =
            |end| Array2::from_shape_simple_fn((rows, columns), || random.below(end).cast_signed());
        let (trials, share, of_template) = (integers(9), integers(100), integers(50));
        let percent = integers(98);
        let ones = Array2::from_shape_fn((rows, columns), |i| trials[i] * share[i] / 100);
        let remainders = (rows, 2, columns.div_ceil(BLOCK));
        Self {
            ones,
            trials,
            remainders: Array3::from_shape_simple_fn(remainders, || {
                random.below(100) as f32 / 10.0 - 5.0
            }),
            probability: percent.mapv(|percent| (percent + 1) as f32 / 100.0),
            of_template,
        }
    }

    pub fn sums(&self) -> Sums<'_> {
        Sums {
            ones: self.ones.view(),
            trials: self.trials.view(),
            remainders: self.remainders.view(),
            frames: 8,
        }
    }

    pub fn counts(&self) -> Counts<'_> {
        Counts {
            ones: self.ones.view(),
            trials: self.trials.view(),
        }
    }

    pub fn comparison<'a>(&'a self, parts: &'a [Counts<'a>]) -> Comparison<'a> {
        Comparison {
            parts,
            probability: self.probability.view(),
            trials_of_template: self.of_template.view(),
        }
    }

    pub fn equations(&self, sigma: f64) -> Result<Equations> {
        let template = Template::new(self.probability.view(), self.of_template.view(), sigma)?;
        normal_equations(&template, self.sums())
    }

    pub fn size(&self) -> (usize, usize) {
        self.ones.dim()
    }
}

pub fn reflected(index: isize, length: usize) -> usize {
    let index = index.rem_euclid(2 * length as isize) as usize;
    index.min(2 * length - 1 - index)
}

/// Return the sum of taps (offset in rows, offset in columns, weight) at each pixel.
pub fn correlate(image: &Array2<f64>, taps: &[(isize, isize, f64)]) -> Array2<f64> {
    let (rows, columns) = image.dim();
    Array2::from_shape_fn((rows, columns), |(row, column)| {
        let value = |&(down, right, weight): &(isize, isize, f64)| {
            let row = reflected(row as isize + down, rows);
            weight * image[[row, reflected(column as isize + right, columns)]]
        };
        taps.iter().map(value).sum()
    })
}

/// Return the variances of the sums over squares of 3 pixels, of which the reflected image repeats some.
pub fn variances_of_sums(variance: &Array2<f64>) -> Array2<f64> {
    let (rows, columns) = variance.dim();
    Array2::from_shape_fn((rows, columns), |(row, column)| {
        let mut weights = Array2::<f64>::zeros((rows, columns));
        for (down, right, weight) in square(1, |_, _| 1.0) {
            let row = reflected(row as isize + down, rows);
            weights[[row, reflected(column as isize + right, columns)]] += weight;
        }
        (&weights * &weights * variance).sum()
    })
}

pub fn square(radius: isize, weight: impl Fn(isize, isize) -> f64) -> Vec<(isize, isize, f64)> {
    let line = -radius..=radius;
    let pairs = line
        .clone()
        .flat_map(|row| line.clone().map(move |column| (row, column)));
    pairs
        .map(|(row, column)| (row, column, weight(row, column)))
        .collect()
}

pub fn variance_per_trial(case: &Case, p: &Array2<f64>) -> Array2<f64> {
    Array2::from_shape_fn(case.size(), |i| {
        let share = 0.35 * f64::from(case.trials[i]) / f64::from(case.of_template[i].max(1));
        p[i] * (1.0 - p[i]) * (1.0 + share)
    })
}

/// Return the ratio of the ones to the number that probabilities predict.
pub fn brightness(case: &Case, p: &Array2<f64>) -> f64 {
    let expected = (case.trials.mapv(f64::from) * p).sum();
    let ones = case.ones.mapv(f64::from).sum();
    if expected > 0.0 {
        (ones / expected).clamp(0.1, 10.0)
    } else {
        1.0
    }
}

/// Return for how many rows of its tile each row stands, which is 0 if it is not compared.
pub fn shares_of_rows((rows, columns): (usize, usize), sigma: f64) -> Vec<f64> {
    let is_small = rows * columns < 1 << 16;
    let step = [4, 2]
        .into_iter()
        .find(|&step| step as f64 <= 2.0 * sigma && !is_small)
        .unwrap_or(1);
    let mut shares = vec![0.0; rows];
    for tile in shares.chunks_mut(TILE) {
        let number = tile.len();
        let first = (step.min(number) - 1) / 2;
        let compared = (first..number).step_by(step);
        let share = number as f64 / compared.clone().count() as f64;
        compared.for_each(|row| tile[row] = share);
    }
    shares
}

/// Return the five sums of all tiles: three of A, and two of b.
pub fn naive_equations(case: &Case, sigma: f64) -> Array3<f64> {
    let radius = (3.0 * sigma + 0.5) as isize;
    let gauss = |x: isize| (-0.5 * (x as f64 / sigma).powi(2)).exp();
    let sum: f64 = (-radius..=radius).map(gauss).sum();
    let taps = square(radius, |row, column| {
        gauss(row) * gauss(column) / (sum * sum)
    });
    let blur = |image: Array2<f64>| correlate(&image, &taps);
    let line = [-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0].map(|tap| tap / 60.0);
    let p = blur(case.probability.mapv(f64::from));
    let gradient = [0, 1].map(|direction| {
        let place = |k| if direction == 0 { (k, 0) } else { (0, k) };
        let taps = (-3..=3)
            .zip(line)
            .map(|(k, tap)| (place(k).0, place(k).1, tap));
        correlate(&p, &taps.collect::<Vec<_>>())
    });
    let ones = blur(case.ones.mapv(f64::from) / brightness(case, &p));
    let trials = blur(case.trials.mapv(f64::from));
    let variance = variance_per_trial(case, &p);
    let (rows, columns) = case.size();
    let mut sums = Array3::zeros((5, rows.div_ceil(TILE), columns.div_ceil(TILE)));
    let shares = shares_of_rows((rows, columns), sigma);
    for ((row, column), &number) in case
        .trials
        .indexed_iter()
        .filter(|(_, number)| **number > 0)
    {
        let i = [row, column];
        let g = [gradient[0][i], gradient[1][i]];
        let shift = [0, 1]
            .map(|direction| f64::from(case.remainders[[row, direction, column / BLOCK]]) / 8.0);
        let expected = p[i] + g[0] * shift[0] + g[1] * shift[1];
        let residual = ones[i] - trials[i] * expected;
        let (number, weight) = (f64::from(number), 1.0 / variance[i]);
        let terms = [
            weight * number * g[0] * g[0],
            weight * number * g[0] * g[1],
            weight * number * g[1] * g[1],
            weight * residual * g[0],
            weight * residual * g[1],
        ];
        for (entry, term) in terms.into_iter().enumerate() {
            sums[[entry, row / TILE, column / TILE]] += shares[row] * term;
        }
    }
    sums
}

pub fn naive_chi_squared(case: &Case) -> Array2<f64> {
    let p = case.probability.mapv(f64::from);
    let trials = case.trials.mapv(f64::from);
    let [small, large] = [1, 4].map(|radius| square(radius, |_, _| 1.0));
    let counted = trials.mapv(|trials| f64::from(u8::from(trials > 0.0)));
    // A few ones and zeros are added to each pixel with trials, and ones to the sums of all pixels.
    let rare = &counted * 0.02;
    let expected = &trials * &p + &rare;
    let zeros = &trials * &(1.0 - &p) + &rare;
    let all = &expected + &zeros;
    let share = 0.35 * &all / case.of_template.mapv(|trials| f64::from(trials.max(1)));
    let variance = &expected * &zeros / all.mapv(|all| all.max(1e-9)) * (1.0 + share);
    let ones = case.ones.mapv(f64::from);
    let more = 0.02 * p.len() as f64;
    let ratio = (ones.sum() + more) / ((&trials * &p).sum() + more);
    let residuals = correlate(
        &((ones + &rare) / ratio.clamp(0.1, 10.0) - &expected),
        &small,
    );
    let variances = variances_of_sums(&variance);
    let ratios = &residuals * &residuals / variances.mapv(|v| v.max(1e-3)) * &counted;
    (correlate(&ratios, &large) + 1.0) / (correlate(&counted, &large) + 1.0)
}
