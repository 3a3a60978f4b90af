//! The evaluation of a network on one patch of a batch: its bits, its residual ĉ − c, its gradient
//! (equation (14)), and its Jacobian (equation (15)).

use std::ops::Range;

use ndarray::{Array2, Array3, ArrayView2, Axis, Zip, s};

use super::backward::ForwardPass;
use super::batch::{Batch, Patch};
use crate::bits::{PackedBits, packed_width, trials};
use crate::error::Result;
use crate::network::first_layer::training_data::FirstLayerData;
use crate::network::layer::Layer;
use crate::numbers::Real;
use crate::sensing::{self, Image, Window, can_draw_counts};
use crate::{interrupt, memory};

/// The maximum number of multiplications in a product of rows of the Jacobian. They take about 50
/// milliseconds.
const MAX_MULTIPLICATIONS: usize = 1 << 30;

/// The maximum number of rows of the Jacobian in a product. The lower triangle of their own products
/// is not used.
const ROWS_PER_PRODUCT: usize = 64;

/// The evaluation of a network on one patch.
pub(super) struct PatchEvaluation<'a, F> {
    pub forward_pass: ForwardPass<'a, F>,
    /// The residual ĉ − c. It is 0 in the border of the patch.
    pub residual: Array2<F>,
    /// The indices of the pixels outside the border, in row-major order.
    pub pixels: Vec<usize>,
}

impl<F: Real> PatchEvaluation<'_, F> {
    /// Return ‖ĉ − c‖².
    pub fn squared_error(&self) -> f64 {
        let residual = self.residual.iter();
        residual.map(|x| x.as_f64() * x.as_f64()).sum()
    }

    /// Return the gradient of ½‖ĉ − c‖² with respect to all parameters: equation (14).
    pub fn gradient(&self, parameters: usize) -> Vec<f64> {
        let mut gradient = vec![0.0; parameters];
        let residual = self.residual.view();
        self.forward_pass.add_gradient(residual, &mut gradient);
        gradient
    }

    /// Add the upper triangle of JᵀJ to a matrix, where J is the Jacobian of the pixels outside the
    /// border: equation (15).
    pub fn add_jacobian_products(&self, matrix: &mut Array2<f64>) {
        let rows = self.forward_pass.jacobian(&self.pixels);
        let shape = (rows.parameters.len(), self.pixels.len());
        let Ok(values) = ArrayView2::from_shape(shape, &rows.values) else {
            return;
        };
        // A product of all rows at once would take too long to be interrupted, and would contain
        // the lower triangle.
        let rows_per_product =
            (MAX_MULTIPLICATIONS / values.len().max(1)).clamp(1, ROWS_PER_PRODUCT);
        for first in (0..shape.0).step_by(rows_per_product) {
            if interrupt::is_requested() {
                return;
            }
            let end = (first + rows_per_product).min(shape.0);
            let products = values
                .slice(s![first..end, ..])
                .dot(&values.slice(s![first.., ..]).t());
            for (index, products) in products.outer_iter().enumerate() {
                let row = rows.parameters[first + index];
                let columns = rows.parameters[first..].iter().zip(products);
                for (&column, value) in columns.skip(index) {
                    matrix[[row, column]] += value.as_f64();
                }
            }
        }
    }
}

impl Batch<'_> {
    /// Simulate the bits of a patch, evaluate the network on them, and return what `measure`
    /// returns.
    pub(super) fn evaluate_patch<F: Real, R>(
        &self,
        layers: &[Layer<F>],
        index: usize,
        measure: impl FnOnce(&PatchEvaluation<'_, F>) -> R,
    ) -> Result<R> {
        let patch = &self.patches[index];
        let image = self.images[patch.image].slice(s![patch.rows.clone(), patch.columns.clone()]);
        let (height, width) = image.dim();
        let side = self.sensor.kernel.oversampling();
        let packed;
        let data = if layers[0].is_tied() && can_draw_counts(&self.sensor) {
            // The layer sees only the counts, so their bits need not be drawn.
            let max = trials(self.frames, side)? as usize;
            FirstLayerData::Counts(self.draw_patch(index, image)?, max)
        } else {
            packed = self.expose_patch(index, image)?;
            let bits = PackedBits::new(packed.view(), width * side)?;
            FirstLayerData::new(bits, side, layers[0].is_tied())?
        };
        let forward_pass = ForwardPass::new(layers, &data)?;

        let (rows, columns) = self.without_border(patch);
        let mut residual = Array2::zeros((height, width));
        let mut pixels = Vec::with_capacity(rows.len() * columns.len());
        let output = forward_pass.output.index_axis(Axis(0), 0);
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
        Ok(measure(&PatchEvaluation {
            forward_pass,
            residual,
            pixels,
        }))
    }

    /// Return the counts of a patch. Each patch has its own random numbers.
    fn draw_patch(&self, index: usize, image: ArrayView2<'_, f32>) -> Result<Array2<i32>> {
        let mut counts = Array2::zeros(image.dim());
        sensing::draw_counts(
            &self.sensor,
            self.frames,
            Image::F32(image),
            self.seed,
            index,
            counts.view_mut(),
        )?;
        Ok(counts)
    }

    /// Return the packed bits of a patch. Each patch has its own frames in the random streams, so
    /// the bits of patches are independent.
    fn expose_patch(&self, index: usize, image: ArrayView2<'_, f32>) -> Result<Array3<u8>> {
        let (height, width) = image.dim();
        let side = self.sensor.kernel.oversampling();
        let shape = (self.frames, height * side, packed_width(width * side));
        let mut packed = memory::zeros("bits of a patch", shape)?;
        let window = Window {
            frames: index.saturating_mul(self.frames)..(index + 1).saturating_mul(self.frames),
            rows: 0..height,
            columns: 0..width,
        };
        let image = Image::F32(image);
        sensing::expose(
            &self.sensor,
            image,
            self.seed,
            0,
            &window,
            packed.view_mut(),
        )?;
        Ok(packed)
    }

    /// Return the rows and the columns of a patch without its border.
    ///
    /// At the border of the image, nothing is removed, because the patch contains all pixels that
    /// the network can read there.
    fn without_border(&self, patch: &Patch) -> (Range<usize>, Range<usize>) {
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
