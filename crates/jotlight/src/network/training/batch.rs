//! The cost, its gradient, and the normal equations for a batch of patches with simulated bits
//! (equations (12), (14), and (15)).

use std::ops::Range;

use ndarray::{Array2, ArrayView2};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::network::graph::check_sequential;
use crate::network::layer::Layer;
use crate::numbers::Real;
use crate::sensing::{PerJot, Sensor};
use crate::{interrupt, memory};

/// The maximum number of matrices in memory. Each is a sum over a fixed part of the batch, so that
/// the result does not depend on the number of threads.
const MAX_MATRICES: usize = 16;

/// A rectangle of pixels of an image.
#[derive(Clone, Debug)]
pub struct Patch {
    /// The index of the image.
    pub image: usize,
    /// The rows of the image.
    pub rows: Range<usize>,
    /// The columns of the image.
    pub columns: Range<usize>,
}

/// Patches of images, and the sensor that turns them into bits.
#[derive(Clone, Debug)]
pub struct Batch<'a> {
    /// The sensor. Efficiency and dark counts must be the same for all jots, and no jot may be
    /// dead.
    pub sensor: Sensor<'a>,
    /// The number T of frames.
    pub frames: usize,
    /// The ground-truth images.
    pub images: Vec<ArrayView2<'a, f32>>,
    /// The parts of the images that the network reconstructs.
    pub patches: Vec<Patch>,
    /// The width of the border of a patch. The cost excludes the border, because the network would
    /// read pixels outside the patch there. It includes the pixels at the border of the image.
    pub border: usize,
    /// The seed of the simulated bits.
    pub seed: [u8; 32],
}

/// The squared error of every patch, and the gradient of the cost.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// ‖ĉ − c‖² of every patch.
    pub squared_errors: Vec<f64>,
    /// The number of pixels in the sum of each squared error.
    pub pixels: Vec<usize>,
    /// The gradient of the cost, the mean of ½‖ĉ − c‖² (equation (12)), with respect to all
    /// parameters. For every layer, the filters precede the spline coefficients.
    pub gradient: Vec<f64>,
}

/// The cost, its gradient, and the matrix of the normal equations.
#[derive(Clone, Debug)]
pub struct NormalEquations {
    /// The cost and its gradient.
    pub gradient: Gradient,
    /// The mean of JᵀJ, where J is the Jacobian of a patch: equation (15).
    pub matrix: Array2<f64>,
}

/// The squared error of a patch, its number of pixels, and its gradient.
type PatchGradient = (f64, usize, Vec<f64>);

impl Batch<'_> {
    /// Return ‖ĉ − c‖² of every patch, and the number of pixels in each sum.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if the layers, the sensor, and the patches do not
    /// match.
    pub fn squared_errors<F: Real>(&self, layers: &[Layer<F>]) -> Result<(Vec<f64>, Vec<usize>)> {
        self.check(layers)?;
        let results: Result<Vec<_>> = (0..self.patches.len())
            .into_par_iter()
            .map(|index| {
                self.evaluate_patch(layers, index, |patch| {
                    (patch.squared_error(), patch.pixels.len())
                })
            })
            .collect();
        Ok(results?.into_iter().unzip())
    }

    /// Return the squared error of every patch, and the gradient of the cost: equation (14).
    ///
    /// The result is the same for any number of threads.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if the layers, the sensor, and the patches do not
    /// match.
    pub fn gradient<F: Real>(&self, layers: &[Layer<F>]) -> Result<Gradient> {
        self.check(layers)?;
        let parameters = layers.iter().map(Layer::parameters).sum();
        memory::check::<f64>(
            "gradients of the patches",
            &[self.patches.len(), parameters],
        )?;
        let patches: Result<Vec<PatchGradient>> = (0..self.patches.len())
            .into_par_iter()
            .map(|index| {
                self.evaluate_patch(layers, index, |patch| {
                    let gradient = patch.gradient(parameters);
                    (patch.squared_error(), patch.pixels.len(), gradient)
                })
            })
            .collect();
        Ok(mean_gradient(parameters, patches?))
    }

    /// Return the cost, its gradient, and the matrix of the normal equations.
    ///
    /// The result is the same for any number of threads.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if the layers, the sensor, and the patches do not
    /// match.
    pub fn normal_equations<F: Real>(&self, layers: &[Layer<F>]) -> Result<NormalEquations> {
        self.check(layers)?;
        let parameters = layers.iter().map(Layer::parameters).sum();
        let number = self.patches.len();
        let parts = MAX_MATRICES.min(number);
        let matrices = "matrices of the normal equations";
        memory::check::<f64>(matrices, &[parts + 1, parameters, parameters])?;
        let results: Result<Vec<_>> = (0..parts)
            .into_par_iter()
            .map(|part| {
                let mut matrix = Array2::<f64>::zeros((parameters, parameters));
                let range = part * number / parts..(part + 1) * number / parts;
                let patches: Result<Vec<PatchGradient>> = range
                    .map(|index| {
                        self.evaluate_patch(layers, index, |patch| {
                            let gradient = patch.gradient(parameters);
                            patch.add_jacobian_products(&mut matrix);
                            (patch.squared_error(), patch.pixels.len(), gradient)
                        })
                    })
                    .collect();
                patches.map(|patches| (patches, matrix))
            })
            .collect();
        // The parts hold the upper triangle.
        let mut matrix = Array2::zeros((parameters, parameters));
        let mut patches = Vec::with_capacity(number);
        for (part, products) in results? {
            if interrupt::is_requested() {
                return Err(Error::Interrupted);
            }
            patches.extend(part);
            matrix += &products;
        }
        matrix /= number as f64;
        for row in 1..parameters {
            for column in 0..row {
                matrix[[row, column]] = matrix[[column, row]];
            }
        }
        Ok(NormalEquations {
            gradient: mean_gradient(parameters, patches),
            matrix,
        })
    }

    fn check<F: Real>(&self, layers: &[Layer<F>]) -> Result<()> {
        check_sequential(layers)?;
        let side = self.sensor.kernel.oversampling();
        let (_, frames, height, width) = layers[0].filters.dim();
        let (block, taps) = ((self.frames, side, side), (frames, height, width));
        if !layers[0].is_tied() && taps != block {
            return Err(Error::shape("filters of the first layer", block, taps));
        }
        let Sensor {
            efficiency,
            dark_counts,
            dead,
            ..
        } = &self.sensor;
        let uniform = matches!(
            (efficiency, dark_counts, dead),
            (PerJot::Same(_), PerJot::Same(_), None)
        );
        if !uniform {
            return Err(Error::range("sensor", "no maps over the jots", "a map"));
        }
        if self.patches.is_empty() {
            return Err(Error::range("patches", "at least one", 0));
        }
        self.patches
            .iter()
            .try_for_each(|patch| self.check_patch(patch))
    }

    fn check_patch(&self, patch: &Patch) -> Result<()> {
        let Some(image) = self.images.get(patch.image) else {
            let expected = "the index of an image of the batch";
            return Err(Error::range("image of a patch", expected, patch.image));
        };
        for (what, range, size) in [
            ("rows of a patch", &patch.rows, image.nrows()),
            ("columns of a patch", &patch.columns, image.ncols()),
        ] {
            if range.is_empty() || range.end > size {
                return Err(Error::shape(what, 0..size, range));
            }
        }
        Ok(())
    }
}

/// Return the squared errors of the patches and the mean of their gradients.
fn mean_gradient(parameters: usize, patches: Vec<PatchGradient>) -> Gradient {
    let number = patches.len() as f64;
    let mut mean = Gradient {
        squared_errors: Vec::new(),
        pixels: Vec::new(),
        gradient: vec![0.0; parameters],
    };
    for (squared_error, pixels, gradient) in patches {
        mean.squared_errors.push(squared_error);
        mean.pixels.push(pixels);
        for (sum, value) in mean.gradient.iter_mut().zip(gradient) {
            *sum += value / number;
        }
    }
    mean
}
