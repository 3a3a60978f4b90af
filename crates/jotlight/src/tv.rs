//! Total variation: the differences D between neighbouring pixels, their adjoint, and the proximal map of Σ |D c|.

use ndarray::{ArrayView2, ArrayView3, ArrayViewMut2, ArrayViewMut3, Axis, Zip, s};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::likelihood::{Step, Values, check_penalty};

/// How the two differences of a pixel make its share of the total variation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Norm {
    /// √(down² + right²): turning the picture changes little.
    Isotropic,
    /// |down| + |right|: edges along the axes are cheaper.
    Anisotropic,
}

impl Norm {
    #[inline(always)]
    fn length(self, down: f64, right: f64) -> f64 {
        match self {
            Self::Isotropic => (down * down + right * right).sqrt(),
            Self::Anisotropic => down.abs() + right.abs(),
        }
    }

    #[inline(always)]
    fn shrink(self, down: f64, right: f64, threshold: f64) -> (f64, f64) {
        match self {
            Self::Isotropic => {
                let length = self.length(down, right);
                let keep = if length > threshold {
                    1.0 - threshold / length
                } else {
                    0.0
                };
                (keep * down, keep * right)
            }
            Self::Anisotropic => {
                let towards_0 = |value: f64| (value.abs() - threshold).max(0.0).copysign(value);
                (towards_0(down), towards_0(right))
            }
        }
    }
}

/// `out = D image`: the difference to the pixel below and to the right, (2, H, W); 0 where there is none.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn differences(image: ArrayView2<'_, f64>, mut out: ArrayViewMut3<'_, f64>) -> Result<()> {
    check(image.dim(), out.dim())?;
    let (height, width) = image.dim();
    let (mut down, mut right) = out.multi_slice_mut((s![0, .., ..], s![1, .., ..]));
    down.axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(right.axis_iter_mut(Axis(0)))
        .enumerate()
        .for_each(|(row, (mut down, mut right))| {
            let here = image.row(row);
            let below = image.row((row + 1).min(height - 1));
            Zip::from(&mut down)
                .and(&below)
                .and(&here)
                .for_each(|down, below, here| *down = below - here);
            for column in 0..width {
                right[column] = here[(column + 1).min(width - 1)] - here[column];
            }
        });
    Ok(())
}

/// `out = Dᵀ planes`.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit.
pub fn adjoint(planes: ArrayView3<'_, f64>, mut out: ArrayViewMut2<'_, f64>) -> Result<()> {
    check(out.dim(), planes.dim())?;
    let (height, width) = out.dim();
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .for_each(|(row, mut out)| {
            // A difference that there is none of is left out: the last row has none below it, the last column none beside it.
            let down = planes.index_axis(Axis(0), 0);
            let right = planes.index_axis(Axis(0), 1);
            for column in 0..width {
                let mut sum = 0.0;
                if row > 0 {
                    sum += down[[row - 1, column]];
                }
                if row + 1 < height {
                    sum -= down[[row, column]];
                }
                if column > 0 {
                    sum += right[[row, column - 1]];
                }
                if column + 1 < width {
                    sum -= right[[row, column]];
                }
                out[column] = sum;
            }
        });
    Ok(())
}

/// Replaces `planes` by the proximal map of Σ threshold · |·|, the point v with the least Σ threshold · |v| + ½ ‖v − planes‖².
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] for a threshold below 0.
pub fn shrink(
    mut planes: ArrayViewMut3<'_, f64>,
    threshold: Values<'_, f64>,
    norm: Norm,
) -> Result<()> {
    let (number, height, width) = planes.dim();
    check((height, width), (number, height, width))?;
    check_weights("threshold", threshold, height * width)?;
    let (mut down, mut right) = planes.multi_slice_mut((s![0, .., ..], s![1, .., ..]));
    down.axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(right.axis_iter_mut(Axis(0)))
        .enumerate()
        .for_each(|(row, (mut down, mut right))| {
            for column in 0..width {
                let threshold = threshold.at(row * width + column);
                (down[column], right[column]) = norm.shrink(down[column], right[column], threshold);
            }
        });
    Ok(())
}

/// One step of ADMM on Σ weight · |D c|: as [`crate::likelihood::Seen::split`] does for the likelihood, with x and its dual (2, H, W).
/// Gives ‖D image − x‖².
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] for a penalty or weight that is none.
pub fn split(
    step: &Step,
    weight: Values<'_, f64>,
    norm: Norm,
    image: ArrayView2<'_, f64>,
    mut x: ArrayViewMut3<'_, f64>,
    mut dual: ArrayViewMut3<'_, f64>,
) -> Result<f64> {
    check(image.dim(), x.dim())?;
    check(image.dim(), dual.dim())?;
    check_penalty(step.penalty)?;
    let (height, width) = image.dim();
    check_weights("weight", weight, height * width)?;
    let (mut x_down, mut x_right) = x.multi_slice_mut((s![0, .., ..], s![1, .., ..]));
    let (mut dual_down, mut dual_right) = dual.multi_slice_mut((s![0, .., ..], s![1, .., ..]));
    let rows = x_down
        .axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(x_right.axis_iter_mut(Axis(0)))
        .zip(dual_down.axis_iter_mut(Axis(0)))
        .zip(dual_right.axis_iter_mut(Axis(0)))
        .enumerate();
    let sums: Vec<f64> = rows
        .map(
            |(row, (((mut x_down, mut x_right), mut dual_down), mut dual_right))| {
                let here = image.row(row);
                let below = image.row((row + 1).min(height - 1));
                let mut sum = 0.0;
                for column in 0..width {
                    let down = below[column] - here[column];
                    let right = here[(column + 1).min(width - 1)] - here[column];
                    let to_down = step.relaxed(down, x_down[column]) + dual_down[column];
                    let to_right = step.relaxed(right, x_right[column]) + dual_right[column];
                    let threshold = weight.at(row * width + column) / step.penalty;
                    let (new_down, new_right) = norm.shrink(to_down, to_right, threshold);
                    (x_down[column], x_right[column]) = (new_down, new_right);
                    dual_down[column] = to_down - new_down;
                    dual_right[column] = to_right - new_right;
                    sum += (down - new_down) * (down - new_down);
                    sum += (right - new_right) * (right - new_right);
                }
                sum
            },
        )
        .collect();
    Ok(sums.iter().sum())
}

/// Σ weight · |planes|: the total variation of the image whose differences they are.
///
/// # Errors
/// [`Error::Shape`] when the arrays do not fit, [`Error::Range`] for a weight below 0.
pub fn total(planes: ArrayView3<'_, f64>, weight: Values<'_, f64>, norm: Norm) -> Result<f64> {
    let (number, height, width) = planes.dim();
    check((height, width), (number, height, width))?;
    check_weights("weight", weight, height * width)?;
    // Rows are added up one by one and then in order, so that the sum is the same for any number of threads.
    let rows: Vec<f64> = (0..height)
        .into_par_iter()
        .map(|row| {
            let lengths = (0..width).map(|column| {
                let length = norm.length(planes[[0, row, column]], planes[[1, row, column]]);
                weight.at(row * width + column) * length
            });
            lengths.sum()
        })
        .collect();
    Ok(rows.iter().sum())
}

fn check_weights(what: &'static str, weights: Values<'_, f64>, length: usize) -> Result<()> {
    weights.check(what, length)?;
    let bad = |weight: &f64| weight.is_nan() || *weight < 0.0;
    let first = match weights {
        Values::Same(weight) => Some(weight).filter(bad),
        Values::Each(weights) => weights.iter().copied().find(bad),
    };
    first.map_or(Ok(()), |weight| {
        Err(Error::range(what, "0 or more", weight))
    })
}

fn check(image: (usize, usize), planes: (usize, usize, usize)) -> Result<()> {
    if image.0 == 0 || image.1 == 0 {
        return Err(Error::shape("image", "at least one pixel", image));
    }
    if planes == (2, image.0, image.1) {
        Ok(())
    } else {
        Err(Error::shape("differences", (2, image.0, image.1), planes))
    }
}
