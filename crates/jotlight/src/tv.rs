//! Total variation TV(c) = Σ |D c|, where D maps an image to the differences of neighboring pixels:
//! D, its adjoint, the proximal map of the total variation, and an ADMM update (section 2.2.1).
//!
//! The functions take stacks: images have the shape `(N, H, W)`, and differences `(N, 2, H, W)`.

use ndarray::{
    ArrayView2, ArrayView3, ArrayView4, ArrayViewMut2, ArrayViewMut3, ArrayViewMut4, Axis, Zip, s,
};
use rayon::prelude::*;

use crate::admm::AdmmStep;
use crate::error::{Error, Result, check_shape};
use crate::images::for_each_image;
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

/// Write D `images` into `out` `(N, 2, H, W)`.
///
/// The first plane of an image holds the differences to the pixel below, which are 0 in the last
/// row. The second plane holds the differences to the pixel on the right, which are 0 in the last
/// column.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the images are
/// empty.
pub fn differences(images: ArrayView3<'_, f64>, mut out: ArrayViewMut4<'_, f64>) -> Result<()> {
    check_shapes(images.dim(), out.dim())?;
    for_each_image(
        images.outer_iter().zip(out.outer_iter_mut()),
        |(image, out)| {
            write_differences(image, out);
            Ok(())
        },
    )
}

fn write_differences(image: ArrayView2<'_, f64>, mut out: ArrayViewMut3<'_, f64>) {
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
}

/// Write Dᵀ `differences` into `out`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the images are
/// empty.
pub fn adjoint(differences: ArrayView4<'_, f64>, mut out: ArrayViewMut3<'_, f64>) -> Result<()> {
    check_shapes(out.dim(), differences.dim())?;
    let images = differences.outer_iter().zip(out.outer_iter_mut());
    for_each_image(images, |(differences, out)| {
        write_adjoint(differences, out);
        Ok(())
    })
}

fn write_adjoint(differences: ArrayView3<'_, f64>, mut out: ArrayViewMut2<'_, f64>) {
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
}

/// Replace `differences` with the minimizer v of Σ threshold · |v| + ½ ‖v − differences‖².
///
/// This is the proximal map of Σ threshold · |·|.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] for a threshold
/// that is infinite, NaN, or negative, or if the images are empty.
pub fn shrink(
    mut differences: ArrayViewMut4<'_, f64>,
    threshold: Values<'_, f64>,
    norm: Norm,
) -> Result<()> {
    let (images, pixels) = check_differences(differences.dim())?;
    threshold.check("threshold", images * pixels)?;
    let thresholds = threshold.of_images(images, pixels);
    let images = differences.outer_iter_mut().zip(thresholds);
    for_each_image(images, |(differences, threshold)| {
        shrink_image(differences, threshold, norm);
        Ok(())
    })
}

fn shrink_image(mut differences: ArrayViewMut3<'_, f64>, threshold: Values<'_, f64>, norm: Norm) {
    let width = differences.dim().2;
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
}

/// Update `x` and its dual by one ADMM iteration for Σ weight · |x| subject to x = D `images`.
/// Return the squared primal residual ‖D image − x‖² of each image.
///
/// `x` and `dual` have the shape `(N, 2, H, W)`. Each image has its own step.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] for a penalty or a
/// relaxation that is not a finite number above 0, for a weight that is infinite, NaN, or negative,
/// or if the images are empty.
pub fn admm_update(
    steps: &[AdmmStep],
    weight: Values<'_, f64>,
    norm: Norm,
    images: ArrayView3<'_, f64>,
    mut x: ArrayViewMut4<'_, f64>,
    mut dual: ArrayViewMut4<'_, f64>,
) -> Result<Vec<f64>> {
    check_shapes(images.dim(), x.dim())?;
    check_shapes(images.dim(), dual.dim())?;
    let (number, height, width) = images.dim();
    check_shape("steps", number, steps.len())?;
    steps.iter().try_for_each(AdmmStep::check)?;
    weight.check("weight", number * height * width)?;
    let weights = weight.of_images(number, height * width);
    let parameters = steps.iter().zip(weights).zip(images.outer_iter());
    let images = parameters.zip(x.outer_iter_mut().zip(dual.outer_iter_mut()));
    for_each_image(images, |(((step, weight), image), (x, dual))| {
        Ok(update_image(step, weight, norm, image, x, dual))
    })
}

/// Update `x` and its dual for one image, and return its squared primal residual.
fn update_image(
    step: &AdmmStep,
    weight: Values<'_, f64>,
    norm: Norm,
    image: ArrayView2<'_, f64>,
    mut x: ArrayViewMut3<'_, f64>,
    mut dual: ArrayViewMut3<'_, f64>,
) -> f64 {
    let (height, width) = image.dim();
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
    squared_residuals.iter().sum()
}

/// Return Σ weight · |differences| for each image: the weighted total variation of an image with
/// these differences.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] for a weight that
/// is infinite, NaN, or negative, or if the images are empty.
pub fn total_variation(
    differences: ArrayView4<'_, f64>,
    weight: Values<'_, f64>,
    norm: Norm,
) -> Result<Vec<f64>> {
    let (images, pixels) = check_differences(differences.dim())?;
    weight.check("weight", images * pixels)?;
    let weights = weight.of_images(images, pixels);
    let images = differences.outer_iter().zip(weights);
    for_each_image(images, |(differences, weight)| {
        total_of_image(differences, weight, norm)
    })
}

fn total_of_image(
    differences: ArrayView3<'_, f64>,
    weight: Values<'_, f64>,
    norm: Norm,
) -> Result<f64> {
    let (_, height, width) = differences.dim();
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

/// Check the shapes of images `(N, H, W)` and of their differences `(N, 2, H, W)`.
fn check_shapes(
    (number, height, width): (usize, usize, usize),
    differences: (usize, usize, usize, usize),
) -> Result<()> {
    if height == 0 || width == 0 {
        let received = format!("{height} x {width}");
        return Err(Error::range("image", "at least one pixel", received));
    }
    check_shape("differences", (number, 2, height, width), differences)
}

/// Check the shape of differences, and return the numbers of images and of pixels of an image.
fn check_differences(differences: (usize, usize, usize, usize)) -> Result<(usize, usize)> {
    let (number, _, height, width) = differences;
    check_shapes((number, height, width), differences)?;
    Ok((number, height * width))
}
