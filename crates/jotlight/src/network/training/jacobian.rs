//! The Jacobian of an estimate with respect to the parameters, equation (15), by forward
//! differentiation through the layers.

use ndarray::{Array3, Axis, s};

use super::backward::ForwardPass;
use crate::network::convolution::padded::Padded;
use crate::numbers::Real;

/// The rows of a transposed Jacobian that are not 0: dĉ/da for some parameters a.
pub(super) struct JacobianRows<'a, F> {
    /// The pixels of the estimate, which are the columns.
    pixels: &'a [usize],
    /// The index of each row's parameter.
    pub parameters: Vec<usize>,
    /// The values of the rows, one row after the other.
    pub values: Vec<F>,
}

impl<F: Real> JacobianRows<'_, F> {
    fn push(&mut self, parameter: usize, estimate_tangent: &Array3<F>) {
        let Some(tangent) = estimate_tangent.as_slice() else {
            return;
        };
        let start = self.values.len();
        let row = self.pixels.iter().map(|&pixel| tangent[pixel]);
        self.values.extend(row);
        if self.values[start..].iter().all(|x| *x == F::zero()) {
            self.values.truncate(start);
        } else {
            self.parameters.push(parameter);
        }
    }
}

impl<F: Real> ForwardPass<'_, F> {
    /// Return dĉ/da at some pixels for all parameters a, in the order of
    /// [`ForwardPass::add_gradient`]. Parameters that change none of the pixels are left out.
    pub fn jacobian<'p>(&self, pixels: &'p [usize]) -> JacobianRows<'p, F> {
        let mut rows = JacobianRows {
            pixels,
            parameters: Vec::new(),
            values: Vec::new(),
        };
        let mut first = 0;
        for depth in 0..self.layers.len() {
            first = self.add_filter_rows(depth, first, &mut rows);
            first = self.add_coefficient_rows(depth, first, &mut rows);
        }
        rows
    }

    /// Add the rows of a layer's filters, whose parameters begin at `first`. Return the index of
    /// the parameter after them.
    fn add_filter_rows(
        &self,
        depth: usize,
        mut first: usize,
        rows: &mut JacobianRows<'_, F>,
    ) -> usize {
        let (outputs, inputs, height, width) = self.layers[depth].filters.dim();
        let size = (inputs, height, width);
        for channel in 0..outputs {
            let mut visit = |tap: usize, plane: &[F]| {
                let tangent = self.spline_tangent(depth, channel, plane);
                rows.push(first + tap, &self.push_forward(depth, tangent));
            };
            if depth == 0 {
                self.data.for_each_tap(size, |[frame, row, column], plane| {
                    visit((frame * height + row) * width + column, plane);
                });
            } else {
                self.filter_inputs[depth - 1].for_each_tap(size, &mut visit);
            }
            first += inputs * height * width;
        }
        first
    }

    /// Add the rows of a layer's spline coefficients, whose parameters begin at `first`. Return
    /// the index of the parameter after them.
    fn add_coefficient_rows(
        &self,
        depth: usize,
        mut first: usize,
        rows: &mut JacobianRows<'_, F>,
    ) -> usize {
        for (channel, spline) in self.layers[depth].splines.iter().enumerate() {
            let input = self.spline_inputs[depth].index_axis(Axis(0), channel);
            let weights_per_pixel: Vec<_> = input.iter().map(|&z| spline.weights(z)).collect();
            for coefficient in 0..spline.len() {
                let mut tangent = Array3::zeros(self.spline_inputs[depth].dim());
                let mut is_used = false;
                let mut plane = tangent.index_axis_mut(Axis(0), channel);
                for (value, (start, weights)) in plane.iter_mut().zip(&weights_per_pixel) {
                    let weight = coefficient.checked_sub(*start);
                    if let Some(&weight) = weight.and_then(|k| weights.get(k)) {
                        *value = weight;
                        is_used = true;
                    }
                }
                if is_used {
                    rows.push(first + coefficient, &self.push_forward(depth, tangent));
                }
            }
            first += spline.len();
        }
        first
    }

    /// Return the tangent of a layer's output from that of one channel's spline input.
    fn spline_tangent(&self, depth: usize, channel: usize, plane: &[F]) -> Array3<F> {
        let inputs = &self.spline_inputs[depth];
        let spline = &self.layers[depth].splines[channel];
        let mut tangent = Array3::zeros(inputs.dim());
        let outputs = tangent.slice_mut(s![channel, .., ..]).into_iter();
        let inputs = inputs.slice(s![channel, .., ..]);
        for ((out, &z), &change) in outputs.zip(inputs).zip(plane) {
            *out = spline.slope(z) * change;
        }
        tangent
    }

    /// Return the tangent of the estimate from that of a layer's output.
    fn push_forward(&self, depth: usize, mut tangent: Array3<F>) -> Array3<F> {
        if depth == 0 {
            tangent = self.data.to_pixels(tangent);
        }
        let later_layers = self.layers.iter().zip(&self.spline_inputs).skip(depth + 1);
        for (layer, inputs) in later_layers {
            let taps = layer.filter_taps();
            tangent = Padded::mirrored(tangent.view(), taps).convolved(taps);
            let channels = layer.splines.iter().zip(inputs.outer_iter());
            for ((spline, input), mut tangent) in channels.zip(tangent.outer_iter_mut()) {
                tangent.zip_mut_with(&input, |change, &z| *change *= spline.slope(z));
            }
        }
        tangent
    }
}
