//! Total variation TV(c) = Σ |D c|, where D maps an image to the differences of neighboring pixels:
//! D, its adjoint, the proximal map of the total variation, and an ADMM update (section 2.2.1).

use ndarray::{ArrayView2, ArrayView3, ArrayViewMut2, ArrayViewMut3, Axis, Zip, s};
use rayon::prelude::*;

use crate::admm::AdmmStep;
use crate::error::{Error, Result};
use crate::values::Values;
use crate::{interrupt, memory};

/// The norm of the two differences of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Norm {
    /// √(down² + right²), which hardly depends on the direction of an edge.
    Isotropic,
    /// |down| + |right|, which favors edges along the axes.
    Anisotropic,
}

impl Norm {
    /// Return the norm of a pair of differences.
    #[inline(always)]
    fn magnitude(self, down: f64, right: f64) -> f64 {
        match self {
            Self::Isotropic => (down * down + right * right).sqrt(),
            Self::Anisotropic => down.abs() + right.abs(),
        }
    }

    /// Return the proximal map of threshold · norm at a pair of differences.
    #[inline(always)]
    fn shrink(self, down: f64, right: f64, threshold: f64) -> (f64, f64) {
        match self {
            Self::Isotropic => {
                let magnitude = self.magnitude(down, right);
                let factor = if magnitude > threshold {
                    1.0 - threshold / magnitude
                } else {
                    0.0
                };
                (factor * down, factor * right)
            }
            Self::Anisotropic => {
                let soft_threshold =
                    |value: f64| (value.abs() - threshold).max(0.0).copysign(value);
                (soft_threshold(down), soft_threshold(right))
            }
        }
    }
}

/// Write D `image` into `out` `(2, H, W)`.
///
/// The first plane holds the differences to the pixel below, which are 0 in the last row. The
/// second plane holds the differences to the pixel on the right, which are 0 in the last column.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the image is
/// empty.
pub fn differences(image: ArrayView2<'_, f64>, mut out: ArrayViewMut3<'_, f64>) -> Result<()> {
    check_shapes(image.dim(), out.dim())?;
    let (height, width) = image.dim();
    let (mut down, mut right) = out.multi_slice_mut((s![0, .., ..], s![1, .., ..]));
    down.axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(right.axis_iter_mut(Axis(0)))
        .enumerate()
        .for_each(|(row, (mut down, mut right))| {
            if interrupt::is_requested() {
                return;
            }
            let current = image.row(row);
            let below = image.row((row + 1).min(height - 1));
            Zip::from(&mut down)
                .and(&below)
                .and(&current)
                .for_each(|down, below, current| *down = below - current);
            for column in 0..width {
                right[column] = current[(column + 1).min(width - 1)] - current[column];
            }
        });
    Ok(())
}

/// Write Dᵀ `differences` into `out`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the image is
/// empty.
pub fn adjoint(differences: ArrayView3<'_, f64>, mut out: ArrayViewMut2<'_, f64>) -> Result<()> {
    check_shapes(out.dim(), differences.dim())?;
    let (height, width) = out.dim();
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .for_each(|(row, mut out)| {
            if interrupt::is_requested() {
                return;
            }
            let down = differences.index_axis(Axis(0), 0);
            let right = differences.index_axis(Axis(0), 1);
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

/// Replace `differences` with the minimizer v of Σ threshold · |v| + ½ ‖v − differences‖².
///
/// This is the proximal map of Σ threshold · |·|.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] for a threshold
/// that is infinite, NaN, or negative, or if the image is empty.
pub fn shrink(
    mut differences: ArrayViewMut3<'_, f64>,
    threshold: Values<'_, f64>,
    norm: Norm,
) -> Result<()> {
    let (directions, height, width) = differences.dim();
    check_shapes((height, width), (directions, height, width))?;
    threshold.check("threshold", height * width)?;
    let (mut down, mut right) = differences.multi_slice_mut((s![0, .., ..], s![1, .., ..]));
    down.axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(right.axis_iter_mut(Axis(0)))
        .enumerate()
        .for_each(|(row, (mut down, mut right))| {
            if interrupt::is_requested() {
                return;
            }
            for column in 0..width {
                let threshold = threshold.get(row * width + column);
                (down[column], right[column]) = norm.shrink(down[column], right[column], threshold);
            }
        });
    Ok(())
}

/// Update `x` and its dual by one ADMM iteration for Σ weight · |x| subject to x = D `image`.
/// Return the squared primal residual ‖D image − x‖².
///
/// `x` and `dual` have the shape `(2, H, W)`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] for a penalty or a
/// relaxation that is not a finite number above 0, for a weight that is infinite, NaN, or negative,
/// or if the image is empty.
pub fn admm_update(
    step: &AdmmStep,
    weight: Values<'_, f64>,
    norm: Norm,
    image: ArrayView2<'_, f64>,
    mut x: ArrayViewMut3<'_, f64>,
    mut dual: ArrayViewMut3<'_, f64>,
) -> Result<f64> {
    check_shapes(image.dim(), x.dim())?;
    check_shapes(image.dim(), dual.dim())?;
    step.check()?;
    let (height, width) = image.dim();
    weight.check("weight", height * width)?;
    let (mut x_down, mut x_right) = x.multi_slice_mut((s![0, .., ..], s![1, .., ..]));
    let (mut dual_down, mut dual_right) = dual.multi_slice_mut((s![0, .., ..], s![1, .., ..]));
    let rows = x_down
        .axis_iter_mut(Axis(0))
        .into_par_iter()
        .zip(x_right.axis_iter_mut(Axis(0)))
        .zip(dual_down.axis_iter_mut(Axis(0)))
        .zip(dual_right.axis_iter_mut(Axis(0)))
        .enumerate();
    let squared_residuals: Vec<f64> = rows
        .map(
            |(row, (((mut x_down, mut x_right), mut dual_down), mut dual_right))| {
                if interrupt::is_requested() {
                    return 0.0;
                }
                let current = image.row(row);
                let below = image.row((row + 1).min(height - 1));
                let mut sum = 0.0;
                for column in 0..width {
                    let down = below[column] - current[column];
                    let right = current[(column + 1).min(width - 1)] - current[column];
                    let point_down = step.relax(down, x_down[column]) + dual_down[column];
                    let point_right = step.relax(right, x_right[column]) + dual_right[column];
                    let threshold = weight.get(row * width + column) / step.penalty;
                    let (new_down, new_right) = norm.shrink(point_down, point_right, threshold);
                    (x_down[column], x_right[column]) = (new_down, new_right);
                    dual_down[column] = point_down - new_down;
                    dual_right[column] = point_right - new_right;
                    sum += (down - new_down) * (down - new_down);
                    sum += (right - new_right) * (right - new_right);
                }
                sum
            },
        )
        .collect();
    Ok(squared_residuals.iter().sum())
}

/// Return Σ weight · |differences|: the weighted total variation of an image with these
/// differences.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] for a weight that
/// is infinite, NaN, or negative, or if the image is empty.
pub fn total_variation(
    differences: ArrayView3<'_, f64>,
    weight: Values<'_, f64>,
    norm: Norm,
) -> Result<f64> {
    let (directions, height, width) = differences.dim();
    check_shapes((height, width), (directions, height, width))?;
    weight.check("weight", height * width)?;
    // Each row has its own sum, and these sums are added in order, so that the result is the same
    // for any number of threads.
    memory::check::<f64>("sums of the rows", &[height])?;
    let rows: Vec<f64> = (0..height)
        .into_par_iter()
        .map(|row| {
            if interrupt::is_requested() {
                return 0.0;
            }
            let terms = (0..width).map(|column| {
                let (down, right) = (differences[[0, row, column]], differences[[1, row, column]]);
                weight.get(row * width + column) * norm.magnitude(down, right)
            });
            terms.sum()
        })
        .collect();
    Ok(rows.iter().sum())
}

fn check_shapes(image: (usize, usize), differences: (usize, usize, usize)) -> Result<()> {
    if image.0 == 0 || image.1 == 0 {
        let received = format!("{} x {}", image.0, image.1);
        return Err(Error::range("image", "at least one pixel", received));
    }
    if differences == (2, image.0, image.1) {
        Ok(())
    } else {
        Err(Error::shape(
            "differences",
            (2, image.0, image.1),
            differences,
        ))
    }
}
