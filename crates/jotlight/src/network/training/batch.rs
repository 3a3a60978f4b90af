//! Cost, gradient and curvature over a batch of patches, whose bits are drawn on the way.

use std::ops::Range;

use ndarray::{Array2, ArrayView2, Axis, Zip, s};
use rayon::prelude::*;

use crate::bits::{PackedBits, packed_width};
use crate::error::{Error, Result};
use crate::network::first_layer::block::Blocks;
use crate::network::graph::check_chain;
use crate::network::layer::Layer;
use crate::network::training::backward::Trace;
use crate::numbers::Real;
use crate::sensing::{self, Image, PerJot, Sensor, Window};

/// Parts of a batch whose matrices are summed one after the other, whatever the number of threads.
const PARTS: usize = 16;

/// A rectangle of pixels of an image.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Which image.
    pub image: usize,
    /// Rows.
    pub rows: Range<usize>,
    /// Columns.
    pub columns: Range<usize>,
}

/// What a network is tried on: patches of images, each seen by the sensor with frames of its own.
#[derive(Clone, Debug)]
pub struct Batch<'a> {
    /// The sensor; its dark counts are one number, and no jot is dead.
    pub sensor: Sensor<'a>,
    /// T.
    pub frames: usize,
    /// The scenes.
    pub images: Vec<ArrayView2<'a, f32>>,
    /// The parts of them that are seen.
    pub patches: Vec<Patch>,
    /// Pixels along the rim of a patch that do not count, since the network sees past them; an image's own rim does count.
    pub border: usize,
    /// The key of the bits.
    pub seed: [u8; 32],
}

/// The cost of every patch and its gradient.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// ‖ĉ − c‖² of every patch.
    pub errors: Vec<f64>,
    /// The pixels that it is the sum over.
    pub pixels: Vec<usize>,
    /// Of the mean of ½‖ĉ − c‖², equation (12), with respect to all parameters: of every layer the filters, then the coefficients.
    pub gradient: Vec<f64>,
}

/// [`Gradient`] with the matrix of the normal equations.
#[derive(Clone, Debug)]
pub struct NormalEquations {
    /// Cost and gradient.
    pub gradient: Gradient,
    /// The mean of JᵀJ, with J the Jacobian of a patch, equation (15).
    pub matrix: Array2<f64>,
}

impl Batch<'_> {
    fn check<F: Real>(&self, layers: &[Layer<F>]) -> Result<()> {
        check_chain(layers)?;
        let side = self.sensor.kernel.oversampling();
        let (_, frames, lines, columns) = layers[0].filters.dim();
        let block = (self.frames, side, side);
        if !is_tied(&layers[0]) && (frames, lines, columns) != block {
            return Err(Error::shape(
                "filters of the first layer",
                block,
                (frames, lines, columns),
            ));
        }
        let Sensor {
            efficiency,
            dark_counts,
            dead,
            ..
        } = &self.sensor;
        if !matches!(
            (efficiency, dark_counts, dead),
            (PerJot::Same(_), PerJot::Same(_), None)
        ) {
            return Err(Error::range("sensor", "no maps over the jots", "a map"));
        }
        if self.patches.is_empty() {
            return Err(Error::range("patches", "at least one", 0));
        }
        for patch in &self.patches {
            let Some(image) = self.images.get(patch.image) else {
                return Err(Error::range(
                    "image of a patch",
                    "one of those given",
                    patch.image,
                ));
            };
            for (what, range, size) in [
                ("rows of a patch", &patch.rows, image.nrows()),
                ("columns of a patch", &patch.columns, image.ncols()),
            ] {
                if range.is_empty() || range.end > size {
                    return Err(Error::shape(what, 0..size, range));
                }
            }
        }
        Ok(())
    }

    /// ‖ĉ − c‖² of every patch, and the pixels that it is the sum over.
    ///
    /// # Errors
    /// When the layers, the sensor and the patches do not fit.
    pub fn errors<F: Real>(&self, layers: &[Layer<F>]) -> Result<(Vec<f64>, Vec<usize>)> {
        self.check(layers)?;
        let results: Result<Vec<_>> = (0..self.patches.len())
            .into_par_iter()
            .map(|index| {
                self.run(layers, index, |_, residual, pixels| {
                    (squares(residual), pixels.len())
                })
            })
            .collect();
        Ok(results?.into_iter().unzip())
    }

    /// The cost of every patch, and the gradient of their mean; the same for any number of threads.
    ///
    /// # Errors
    /// When the layers, the sensor and the patches do not fit.
    pub fn gradient<F: Real>(&self, layers: &[Layer<F>]) -> Result<Gradient> {
        self.check(layers)?;
        let parameters = layers.iter().map(Layer::parameters).sum();
        let results: Result<Vec<_>> = (0..self.patches.len())
            .into_par_iter()
            .map(|index| {
                self.run(layers, index, |trace, residual, pixels| {
                    let mut gradient = vec![0.0; parameters];
                    trace.backward(residual, &mut gradient);
                    (squares(residual), pixels.len(), gradient)
                })
            })
            .collect();
        Ok(self.gathered(parameters, results?))
    }

    /// Gradient and matrix of the normal equations; the same for any number of threads.
    ///
    /// # Errors
    /// When the layers, the sensor and the patches do not fit.
    pub fn normal_equations<F: Real>(&self, layers: &[Layer<F>]) -> Result<NormalEquations> {
        self.check(layers)?;
        let parameters = layers.iter().map(Layer::parameters).sum();
        let number = self.patches.len();
        let parts: Result<Vec<_>> = (0..PARTS.min(number))
            .into_par_iter()
            .map(|part| {
                let mut matrix = Array2::<f64>::zeros((parameters, parameters));
                let range =
                    part * number / PARTS.min(number)..(part + 1) * number / PARTS.min(number);
                let results: Result<Vec<_>> = range
                    .map(|index| {
                        self.run(layers, index, |trace, residual, pixels| {
                            let mut gradient = vec![0.0; parameters];
                            trace.backward(residual, &mut gradient);
                            let (rows, values) = trace.jacobian(pixels);
                            add_products(&rows, &values, pixels.len(), &mut matrix);
                            (squares(residual), pixels.len(), gradient)
                        })
                    })
                    .collect();
                results.map(|results| (results, matrix))
            })
            .collect();
        let mut matrix = Array2::zeros((parameters, parameters));
        let mut results = Vec::with_capacity(number);
        for (part, product) in parts? {
            results.extend(part);
            matrix += &product;
        }
        matrix /= number as f64;
        Ok(NormalEquations {
            gradient: self.gathered(parameters, results),
            matrix,
        })
    }

    fn gathered(&self, parameters: usize, results: Vec<(f64, usize, Vec<f64>)>) -> Gradient {
        let mut gradient = vec![0.0; parameters];
        let (mut errors, mut pixels) = (Vec::new(), Vec::new());
        for (error, number, part) in results {
            errors.push(error);
            pixels.push(number);
            for (sum, part) in gradient.iter_mut().zip(part) {
                *sum += part / self.patches.len() as f64;
            }
        }
        Gradient {
            errors,
            pixels,
            gradient,
        }
    }

    /// Draws the bits of a patch, runs the network, and gives `work` the run, ĉ − c (0 where it does not count) and the pixels
    /// that count.
    fn run<F: Real, R>(
        &self,
        layers: &[Layer<F>],
        index: usize,
        work: impl FnOnce(&Trace<'_, F>, ArrayView2<'_, F>, &[usize]) -> R,
    ) -> Result<R> {
        let patch = &self.patches[index];
        let image = self.images[patch.image].slice(s![patch.rows.clone(), patch.columns.clone()]);
        let (height, width) = image.dim();
        let side = self.sensor.kernel.oversampling();
        let mut packed =
            ndarray::Array3::zeros((self.frames, height * side, packed_width(width * side)));
        let window = Window {
            frames: index * self.frames..(index + 1) * self.frames,
            rows: 0..height,
            columns: 0..width,
        };
        sensing::expose(
            &self.sensor,
            Image::F32(image),
            self.seed,
            0,
            &window,
            packed.view_mut(),
        )?;
        let bits = PackedBits::new(packed.view(), width * side)?;
        let blocks = Blocks::of(bits, side, is_tied(&layers[0]))?;
        let trace = Trace::new(layers, &blocks);

        let (rows, columns) = self.counted(patch);
        let mut residual = Array2::zeros((height, width));
        let mut pixels = Vec::with_capacity(rows.len() * columns.len());
        let output = trace.output.index_axis(Axis(0), 0);
        for row in rows {
            let inside = s![row, columns.clone()];
            Zip::from(residual.slice_mut(inside))
                .and(output.slice(inside))
                .and(image.slice(inside))
                .for_each(|out, &estimate, &truth| {
                    *out = estimate - F::from_f64(f64::from(truth));
                });
            pixels.extend(columns.clone().map(|column| row * width + column));
        }
        Ok(work(&trace, residual.view(), &pixels))
    }

    /// The rows and columns of a patch that count.
    fn counted(&self, patch: &Patch) -> (Range<usize>, Range<usize>) {
        let image = &self.images[patch.image];
        let inside = |range: &Range<usize>, size: usize| {
            let first = if range.start == 0 { 0 } else { self.border };
            let last = if range.end == size { 0 } else { self.border };
            let end = range.len().saturating_sub(last);
            first.min(end)..end
        };
        (
            inside(&patch.rows, image.nrows()),
            inside(&patch.columns, image.ncols()),
        )
    }
}

/// Whether one weight serves a whole block.
fn is_tied<F: Real>(layer: &Layer<F>) -> bool {
    let (_, frames, lines, columns) = layer.filters.dim();
    (frames, lines, columns) == (1, 1, 1)
}

fn squares<F: Real>(residual: ArrayView2<'_, F>) -> f64 {
    residual.iter().map(|x| x.as_f64() * x.as_f64()).sum()
}

/// Adds J·Jᵀ of rows over pixels to the rows and columns of the matrix that they belong to.
fn add_products<F: Real>(rows: &[usize], values: &[F], pixels: usize, matrix: &mut Array2<f64>) {
    let Ok(values) = ArrayView2::from_shape((rows.len(), pixels), values) else {
        return;
    };
    let products = values.dot(&values.t());
    for (&row, products) in rows.iter().zip(products.outer_iter()) {
        for (&column, value) in rows.iter().zip(products) {
            matrix[[row, column]] += value.as_f64();
        }
    }
}
