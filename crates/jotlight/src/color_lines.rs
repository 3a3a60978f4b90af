//! Colors on lines: color differences of neighboring pixels as linear functions of their light.
//!
//! Where two colors meet, all mixtures of them lie on a line between both. So in most small windows,
//! R − Y and B − Y are linear functions of the light Y = (R + 2G + B)/4 (I. Omer and M. Werman,
//! "Color lines: image specific color representation", CVPR 2004). Color fringes are deviations from
//! these lines. As in a guided filter, each window has lines by least squares, and each pixel has
//! the mean over the windows that contain it (K. He, J. Sun, X. Tang, "Guided image filtering", IEEE
//! TPAMI 35(6), 2013). Windows whose colors deviate less from their lines count more.

use ndarray::{ArrayView3, ArrayViewMut3, Axis, Zip};
use rayon::prelude::*;

use crate::border::mirror_index;
use crate::error::{Error, Result};
use crate::filter::{LANES, filter_twice};
use crate::interrupt;

/// The sides of the windows in pixels. Larger ones alone blur the colors of photographs.
const SIDES: [usize; 2] = [5, 9];

/// The largest distance at which a pixel influences another one: both are in the same window.
const REACH: usize = SIDES[1] - 1;

/// The number of rows that one task estimates.
const ROWS_PER_TASK: usize = 64;

/// The variance of the light, relative to its squared mean, at which the slope of a line is half of
/// that by least squares.
const SLOPE_NOISE: f32 = 4e-4;

/// The variance of the colors about their lines, relative to the squared mean of the light, from
/// which windows count less.
const DEVIATION: f32 = 1e-3;

/// The smallest sum of these variances, relative to the squared unit. Its third power is above 0.
const MIN_VARIANCE: f32 = 1e-11;

/// The smallest variance of the light by which is divided, relative to the squared unit.
const MIN_LIGHT_VARIANCE: f32 = 1e-20;

/// Write red, green, and blue `(3, H, W)` on lines into `out`. The light Y of each pixel is kept.
///
/// The unit of the colors does not matter: twice the colors have twice the result.
///
/// # Errors
/// [`Error::Shape`] if the shapes differ or do not have three colors.
///
/// # Examples
/// ```
/// use ndarray::Array3;
///
/// // White and blue mix, and a green pixel is between them.
/// let blue = [0.0, 0.0, 1.0];
/// let mut colors = Array3::from_shape_fn((3, 9, 9), |(color, _, column)| {
///     let white = (column % 3) as f32 / 2.0;
///     white + (1.0 - white) * blue[color]
/// });
/// colors[(1, 4, 4)] += 0.3;
/// let mut found = colors.clone();
/// jotlight::color_lines::color_lines(colors.view(), found.view_mut())?;
/// assert!(found[(1, 4, 4)] - found[(0, 4, 4)] < 0.1);
/// # Ok::<(), jotlight::error::Error>(())
/// ```
pub fn color_lines(colors: ArrayView3<'_, f32>, mut out: ArrayViewMut3<'_, f32>) -> Result<()> {
    let (channels, height, width) = colors.dim();
    if channels != 3 {
        return Err(Error::shape("colors", (3, height, width), colors.dim()));
    }
    if out.dim() != colors.dim() {
        return Err(Error::shape("output", colors.dim(), out.dim()));
    }
    if out.is_empty() {
        return Ok(());
    }
    let unit = unit_of(colors);
    let bands: Vec<_> = out.axis_chunks_iter_mut(Axis(1), ROWS_PER_TASK).collect();
    bands.into_par_iter().enumerate().for_each(|(band, out)| {
        if !interrupt::is_requested() {
            estimate_band(colors, unit, band * ROWS_PER_TASK, out);
        }
    });
    Ok(())
}

/// Return the unit of colors: the power of 2 that is at least their largest absolute value.
///
/// It scales all numbers exactly. In this unit, variances and their third powers are finite.
fn unit_of(colors: ArrayView3<'_, f32>) -> f32 {
    let largest = |peak: f32, &color: &f32| peak.max(color.abs());
    let peak = Zip::from(colors).par_fold(|| 0.0, largest, f32::max);
    // Adding the largest mantissa raises the exponent of all numbers but powers of 2.
    let (mantissa, exponent) = (0x007f_ffff, 0x7f80_0000);
    let power = f32::from_bits((peak.to_bits() + mantissa) & exponent);
    // The inverses of both limits are normal numbers.
    power.clamp(f32::MIN_POSITIVE, 1.0 / f32::MIN_POSITIVE)
}

/// Write the rows of a band into `out`. `first` is its first row in the image.
fn estimate_band(
    colors: ArrayView3<'_, f32>,
    unit: f32,
    first: usize,
    mut out: ArrayViewMut3<'_, f32>,
) {
    let (_, rows, width) = out.dim();
    let stride = width.next_multiple_of(LANES);
    let near = Near::read(colors, unit, first, rows, stride);
    let mut sums = Sums::new(rows * stride);
    for side in SIDES {
        near.add_windows(side, rows, width, &mut sums);
    }
    for row in 0..rows {
        let light = &near.light[(row + REACH) * stride..];
        for column in 0..width {
            let at = row * stride + column;
            let share = 1.0 / sums.weights[at];
            let [red, blue] = [0, 1].map(|color| {
                share * (sums.slopes[color][at] * light[column] + sums.offsets[color][at])
            });
            let light = light[column];
            out[(0, row, column)] = unit * (light + red);
            out[(1, row, column)] = unit * (light - 0.5 * (red + blue));
            out[(2, row, column)] = unit * (light + blue);
        }
    }
}

/// A band of rows with [`REACH`] rows before and after, in the unit of the colors.
struct Near {
    /// The light Y of each pixel.
    light: Vec<f32>,
    /// R − Y and B − Y. The sum of both is −2 (G − Y).
    differences: [Vec<f32>; 2],
    stride: usize,
}

impl Near {
    fn read(
        colors: ArrayView3<'_, f32>,
        unit: f32,
        first: usize,
        rows: usize,
        stride: usize,
    ) -> Self {
        let scale = 1.0 / unit;
        let (_, height, width) = colors.dim();
        let mut light = vec![0.0; (rows + 2 * REACH) * stride];
        let mut differences = [light.clone(), light.clone()];
        for row in 0..rows + 2 * REACH {
            let source = mirror_index((first + row) as isize - REACH as isize, height);
            for column in 0..width {
                let [red, green, blue] =
                    [0, 1, 2].map(|color| scale * colors[(color, source, column)]);
                let at = row * stride + column;
                light[at] = 0.25 * (red + blue) + 0.5 * green;
                differences[0][at] = red - light[at];
                differences[1][at] = blue - light[at];
            }
        }
        Self {
            light,
            differences,
            stride,
        }
    }

    /// Add the lines of the windows with one side to the sums of the pixels.
    fn add_windows(&self, side: usize, rows: usize, width: usize, sums: &mut Sums) {
        // The windows of the pixels of the band have their centers in these rows.
        let centers = rows + 2 * (side / 2);
        let unused = (REACH - 2 * (side / 2)) * self.stride;
        let near = |values: &[f32]| {
            window_means(
                &values[unused..values.len() - unused],
                side,
                self.stride,
                width,
            )
        };
        let mean_product = |first: &[f32], second: &[f32]| {
            let product: Vec<_> = first.iter().zip(second).map(|(a, b)| a * b).collect();
            near(&product)
        };
        let (light, squares) = (near(&self.light), mean_product(&self.light, &self.light));
        let moments = [0, 1].map(|color| {
            let difference = &self.differences[color];
            Moments {
                mean: near(difference),
                square: mean_product(difference, difference),
                with_light: mean_product(difference, &self.light),
            }
        });
        let mut lines = Sums::new(centers * self.stride);
        for at in 0..centers * self.stride {
            let square = light[at] * light[at];
            let variance = (squares[at] - square).max(0.0);
            let slope_variance = variance + SLOPE_NOISE * square + MIN_LIGHT_VARIANCE;
            let found = [0, 1].map(|color| moments[color].line(at, light[at], slope_variance));
            let deviation = found[0].variance + found[1].variance + DEVIATION * square;
            let weight = deviation.max(MIN_VARIANCE).powi(-3);
            lines.weights[at] = weight;
            for (color, line) in found.into_iter().enumerate() {
                lines.slopes[color][at] = weight * line.slope;
                lines.offsets[color][at] = weight * line.offset;
            }
        }
        sums.add(&lines, |values| {
            window_means(values, side, self.stride, width)
        });
    }
}

/// Return the means of square windows of padded rows. The result lacks the rows whose windows would
/// contain others.
fn window_means(values: &[f32], side: usize, stride: usize, width: usize) -> Vec<f32> {
    let mut out = vec![0.0; values.len() - 2 * (side / 2) * stride];
    filter_twice(values, 1, &vec![1.0 / side as f32; side], &mut out, width);
    out
}

/// The means of a color difference in windows, of its square, and of its product with the light.
struct Moments {
    mean: Vec<f32>,
    square: Vec<f32>,
    with_light: Vec<f32>,
}

/// A color difference as a linear function of the light, and its variance about this line.
struct Line {
    slope: f32,
    offset: f32,
    variance: f32,
}

impl Moments {
    /// Return the line of a window with a mean of the light and a variance of it.
    fn line(&self, at: usize, light: f32, variance: f32) -> Line {
        let mean = self.mean[at];
        let covariance = self.with_light[at] - mean * light;
        let slope = covariance / variance;
        Line {
            slope,
            offset: mean - slope * light,
            variance: (self.square[at] - mean * mean - slope * covariance).max(0.0),
        }
    }
}

/// The weights of lines, and their slopes and offsets times these weights.
struct Sums {
    weights: Vec<f32>,
    slopes: [Vec<f32>; 2],
    offsets: [Vec<f32>; 2],
}

impl Sums {
    fn new(length: usize) -> Self {
        let zeros = || vec![0.0; length];
        Self {
            weights: zeros(),
            slopes: [zeros(), zeros()],
            offsets: [zeros(), zeros()],
        }
    }

    /// Add the means of lines over the windows that contain a pixel.
    fn add(&mut self, lines: &Self, means: impl Fn(&[f32]) -> Vec<f32>) {
        let add = |sum: &mut [f32], values: &[f32]| {
            let found = means(values);
            sum.iter_mut()
                .zip(found)
                .for_each(|(sum, value)| *sum += value);
        };
        add(&mut self.weights, &lines.weights);
        for color in 0..2 {
            add(&mut self.slopes[color], &lines.slopes[color]);
            add(&mut self.offsets[color], &lines.offsets[color]);
        }
    }
}
