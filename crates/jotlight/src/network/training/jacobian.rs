//! The Jacobian of an estimate with respect to the parameters, equation (15).
//!
//! A *tangent* is the derivative of a layer's planes with respect to one parameter. Forward
//! differentiation propagates it through the later layers to the estimate.

use ndarray::{Array3, Axis, s};

use super::backward::ForwardPass;
use crate::interrupt;
use crate::network::convolution::padded::Padded;
use crate::numbers::Real;

/// The rows of the transposed Jacobian that are not 0. A row is dĉ/da for one parameter a.
pub(super) struct JacobianRows<'a, F> {
    /// The indices of the estimate's pixels, which are the columns.
    pixels: &'a [usize],
    /// The index of the parameter of each row.
    pub parameters: Vec<usize>,
    /// The values of the rows, one row after the other.
    pub values: Vec<F>,
}

impl<F: Real> JacobianRows<'_, F> {
    /// Append the row of a parameter, unless all its values are 0.
    fn append_nonzero_row(&mut self, parameter: usize, estimate_tangent: &Array3<F>) {
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
    /// Return dĉ/da at the pixels `pixels` for all parameters a: equation (15).
    ///
    /// The parameters have the same order as in [`ForwardPass::add_gradient`]. Parameters that
    /// change none of the pixels are left out.
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

    /// Append the rows of the taps of the layer `depth`. `first` is the index of their first
    /// parameter. Return the index of the parameter that follows them.
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
                rows.append_nonzero_row(first + tap, &self.push_forward(depth, tangent));
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

    /// Append the rows of the spline coefficients of the layer `depth`. `first` is the index of
    /// their first parameter. Return the index of the parameter that follows them.
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
                if interrupt::is_requested() {
                    break;
                }
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
                    rows.append_nonzero_row(
                        first + coefficient,
                        &self.push_forward(depth, tangent),
                    );
                }
            }
            first += spline.len();
        }
        first
    }

    /// Return the tangent of a layer's output. `plane` is the tangent of the spline's input in one
    /// channel. The tangents of the other channels are 0.
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

    /// Return the tangent of the estimate from the tangent of a layer's output.
    fn push_forward(&self, depth: usize, mut tangent: Array3<F>) -> Array3<F> {
        if depth == 0 {
            tangent = self.data.to_pixels(tangent);
        }
        let later_layers = self.layers.iter().zip(&self.spline_inputs).skip(depth + 1);
        for (layer, inputs) in later_layers {
            if interrupt::is_requested() {
                break;
            }
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

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array4};

    use super::*;
    use crate::bits::PackedBits;
    use crate::error::Result;
    use crate::network::first_layer::training_data::FirstLayerData;
    use crate::network::layer::{Layer, Wiring};

    const SHAPES: [(usize, usize, usize, usize); 2] = [(2, 1, 2, 2), (1, 2, 3, 3)];
    const COEFFICIENTS: usize = 7;

    fn layers(parameters: &[f64]) -> Result<Vec<Layer<f64>>> {
        let mut values = parameters.iter().copied();
        let layer = |shape: (usize, usize, usize, usize)| {
            let mut next = || values.next().unwrap_or(f64::NAN);
            let filters = Array4::from_shape_simple_fn(shape, &mut next);
            let coefficients = Array2::from_shape_simple_fn((shape.0, COEFFICIENTS), next);
            Layer::new(
                filters,
                Some(coefficients.view()),
                -4.0,
                2.0,
                Wiring::default(),
            )
        };
        SHAPES.into_iter().map(layer).collect()
    }

    fn first_layer_data(packed: &Array3<u8>) -> Result<FirstLayerData<'_>> {
        let bits = PackedBits::new(packed.view(), 14)?;
        FirstLayerData::new(bits, 2, false)
    }

    fn estimate(parameters: &[f64], packed: &Array3<u8>) -> Result<Array3<f64>> {
        let (layers, data) = (layers(parameters)?, first_layer_data(packed)?);
        Ok(ForwardPass::new(&layers, &data)?.output)
    }

    #[test]
    fn rows_agree_with_central_differences_of_the_estimate() -> Result<()> {
        let packed =
            Array3::from_shape_fn((1, 8, 2), |(_, row, byte)| (row * 89 + byte * 57) as u8);
        let data = first_layer_data(&packed)?;
        let count = 2 * 4 + 2 * COEFFICIENTS + 18 + COEFFICIENTS;
        let mut parameters: Vec<f64> = (0..count)
            .map(|k| ((k * k) as f64 * 0.37).sin() * 0.6)
            .collect();
        let pixels = [0, 5, 9, 27];
        let initial = layers(&parameters)?;
        let rows = ForwardPass::new(&initial, &data)?.jacobian(&pixels);
        let step = 1e-6;
        for parameter in 0..count {
            let value = parameters[parameter];
            parameters[parameter] = value + step;
            let above = estimate(&parameters, &packed)?;
            parameters[parameter] = value - step;
            let below = estimate(&parameters, &packed)?;
            parameters[parameter] = value;
            let row = rows.parameters.iter().position(|&index| index == parameter);
            for (column, &pixel) in pixels.iter().enumerate() {
                let index = [0, pixel / 7, pixel % 7];
                let expected = (above[index] - below[index]) / (2.0 * step);
                let found = row.map_or(0.0, |row| rows.values[row * pixels.len() + column]);
                assert!((found - expected).abs() < 1e-7);
            }
        }
        Ok(())
    }
}
