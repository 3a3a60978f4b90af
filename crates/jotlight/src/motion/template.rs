//! The probabilities to which blocks of frames are compared.

use ndarray::{ArrayView2, Axis};
use rayon::prelude::*;

use super::gradient::{RADIUS, differentiate};
use crate::bits::contiguous;
use crate::border::mirror_index;
use crate::error::{Error, Result};
use crate::filter::{LANES, ROWS_PER_TASK, filter_rows, gaussian};
use crate::{interrupt, memory};

/// The variance of the template of D_R trials, in units of that of the raw fraction of ones.
pub(super) const SHARE_OF_TEMPLATE: f32 = 0.35;

/// The probability of a one at each pixel at the reference time, after a Gaussian filter, with its
/// derivatives.
///
/// The rows of all planes are padded to a multiple of `LANES` values.
#[derive(Clone, Debug)]
pub struct Template {
    pub(super) size: (usize, usize),
    /// The number of values of a row.
    pub(super) stride: usize,
    /// The taps of the filter.
    pub(super) taps: Vec<f32>,
    /// The distance of the rows that are compared.
    pub(super) step: usize,
    /// p.
    pub(super) probability: Vec<f32>,
    /// The derivatives of p along rows and columns.
    pub(super) gradient: [Vec<f32>; 2],
    /// max(D_R, 1).
    pub(super) trials: Vec<f32>,
}

impl Template {
    /// Return a template after a Gaussian filter with the standard deviation `sigma` in pixels.
    ///
    /// `trials` is D_R, the number of trials of each pixel of the template.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the image is
    /// empty, a probability is not above 0 and below 1, a number of trials is negative, or the
    /// standard deviation is not above 0 and at most 100. [`Error::Memory`] if the memory is not
    /// available.
    pub fn new(
        probability: ArrayView2<'_, f32>,
        trials: ArrayView2<'_, i32>,
        sigma: f64,
    ) -> Result<Self> {
        let size = probability.dim();
        let stride = size.1.next_multiple_of(LANES);
        memory::check::<f32>("template", &[4, size.0, stride])?;
        check_template(probability, trials)?;
        let taps = gaussian(sigma)?;
        let plane = || vec![0.0; size.0 * stride];
        let mut template = Self {
            size,
            stride,
            taps,
            step: row_step(sigma, size),
            probability: plane(),
            gradient: [plane(), plane()],
            trials: plane(),
        };
        template.filter(probability);
        template.differentiate();
        let rows = template.trials.par_chunks_mut(stride);
        rows.zip(trials.axis_iter(Axis(0))).for_each(|(out, row)| {
            for (out, &trials) in out.iter_mut().zip(contiguous(row).iter()) {
                *out = trials.max(1) as f32;
            }
        });
        Ok(template)
    }

    /// Apply the Gaussian filter.
    fn filter(&mut self, image: ArrayView2<'_, f32>) {
        let Self {
            stride,
            taps,
            probability,
            ..
        } = self;
        let bands = probability.par_chunks_mut(ROWS_PER_TASK * *stride);
        bands.enumerate().for_each(|(band, out)| {
            if !interrupt::is_requested() {
                filter_rows(image, band * ROWS_PER_TASK, taps, out);
            }
        });
    }

    /// Compute the derivatives.
    fn differentiate(&mut self) {
        let Self {
            size: (height, width),
            stride,
            probability,
            gradient: [along_rows, along_columns],
            ..
        } = self;
        let (height, width, stride, source) = (*height, *width, *stride, &probability[..]);
        let bands = along_rows
            .par_chunks_mut(ROWS_PER_TASK * stride)
            .zip(along_columns.par_chunks_mut(ROWS_PER_TASK * stride));
        bands
            .enumerate()
            .for_each(|(band, (along_rows, along_columns))| {
                if interrupt::is_requested() {
                    return;
                }
                let first = (band * ROWS_PER_TASK) as isize - RADIUS as isize;
                let mut near = vec![0.0; (along_rows.len() / stride + 2 * RADIUS) * stride];
                for (index, near) in near.chunks_exact_mut(stride).enumerate() {
                    let row = mirror_index(first + index as isize, height);
                    near.copy_from_slice(&source[row * stride..][..stride]);
                }
                differentiate(&near, along_rows, along_columns, width);
            });
    }
}

/// The number of pixels of an image from which some of its rows show the motion as well as all.
const PIXELS: usize = 1 << 16;

/// Return the distance of the rows that are compared: 1, 2, or 4, up to twice the width of the
/// filter, and 1 for small images.
///
/// A Gaussian filter leaves a tenth of the power of finer details, or less.
fn row_step(sigma: f64, size: (usize, usize)) -> usize {
    match sigma {
        _ if size.0 * size.1 < PIXELS => 1,
        2.0.. => 4,
        1.0.. => 2,
        _ => 1,
    }
}

/// Return whether the probabilities of a row of a template are above 0 and below 1, and its numbers of
/// trials are not negative.
#[inline(always)]
pub(super) fn are_possible(probabilities: &[f32], trials: &[i32]) -> bool {
    // Without an early end, the compiler vectorizes the searches.
    let wrong = probabilities
        .iter()
        .fold(0, |wrong, &p| wrong | u32::from(!(p > 0.0 && p < 1.0)));
    wrong == 0 && trials.iter().copied().fold(0, i32::min) >= 0
}

/// Check that a template has pixels, and that its arrays have the same shape.
pub(super) fn check_template_shapes(
    probability: ArrayView2<'_, f32>,
    trials: ArrayView2<'_, i32>,
) -> Result<()> {
    if probability.is_empty() {
        let received = format!("{:?}", probability.dim());
        return Err(Error::range("size", "at least one pixel", received));
    }
    if trials.dim() != probability.dim() {
        let (expected, received) = (probability.dim(), trials.dim());
        return Err(Error::shape("trials of the template", expected, received));
    }
    Ok(())
}

/// Check that a template has pixels, that their probabilities are above 0 and below 1, and that
/// their numbers of trials are not negative.
pub(super) fn check_template(
    probability: ArrayView2<'_, f32>,
    trials: ArrayView2<'_, i32>,
) -> Result<()> {
    check_template_shapes(probability, trials)?;
    for (probabilities, trials) in probability.rows().into_iter().zip(trials.rows()) {
        let (probabilities, trials) = (contiguous(probabilities), contiguous(trials));
        if are_possible(&probabilities, &trials) {
            continue;
        }
        let wrong = probabilities
            .iter()
            .copied()
            .find(|&p| !(p > 0.0 && p < 1.0));
        if wrong.is_some() {
            return Err(Error::range(
                "probabilities of the template",
                "numbers above 0 and below 1",
                wrong.unwrap_or_default(),
            ));
        }
        let fewest = trials.iter().copied().fold(0, i32::min);
        if fewest < 0 {
            return Err(Error::range("trials of the template", "at least 0", fewest));
        }
    }
    Ok(())
}
