//! Error backpropagation: a sweep from the last layer to the first computes the gradient of the
//! cost of one patch. For two layers, this is equations (14) to (19).

use ndarray::{Array3, ArrayView2, ArrayViewMut4, Axis};

use crate::error::{Error, Result};
use crate::interrupt;
use crate::network::convolution::padded::Padded;
use crate::network::first_layer::training_data::FirstLayerData;
use crate::network::layer::Layer;
use crate::network::tiling::strips::PlanesMut;
use crate::numbers::Real;

/// A forward pass that keeps the intermediate results for differentiation.
pub(super) struct ForwardPass<'a, F> {
    pub layers: &'a [Layer<F>],
    pub data: &'a FirstLayerData<'a>,
    /// The input of the filters of each layer but the first.
    pub filter_inputs: Vec<Padded<F>>,
    /// The input of the splines of each layer.
    pub spline_inputs: Vec<Array3<F>>,
    /// The estimate ĉ, `(1, H, W)`.
    pub output: Array3<F>,
}

impl<'a, F: Real> ForwardPass<'a, F> {
    /// Evaluate the layers, and keep the intermediate results. The layers must match each other and
    /// the data.
    ///
    /// # Errors
    /// [`Error::Interrupted`] and [`Error::Memory`].
    pub fn new(layers: &'a [Layer<F>], data: &'a FirstLayerData<'a>) -> Result<Self> {
        let mut filter_inputs = Vec::with_capacity(layers.len());
        let mut spline_inputs = Vec::with_capacity(layers.len());
        let mut planes = Array3::default((0, 0, 0));
        for (index, layer) in layers.iter().enumerate() {
            if interrupt::is_requested() {
                return Err(Error::Interrupted);
            }
            let filtered = if index == 0 {
                data.filter(layer.filters())?
            } else {
                let padded = Padded::mirrored(planes.view(), layer.filter_taps());
                let filtered = padded.convolved(layer.filter_taps());
                filter_inputs.push(padded);
                filtered
            };
            planes.clone_from(&filtered);
            let (_, height, width) = planes.dim();
            if let Some(planes) = planes.as_slice_mut() {
                layer.activate(&mut PlanesMut::contiguous(planes, (height, width)));
            }
            if index == 0 {
                planes = data.to_pixels(planes);
            }
            spline_inputs.push(filtered);
        }
        Ok(Self {
            layers,
            data,
            filter_inputs,
            spline_inputs,
            output: planes,
        })
    }

    /// Add the gradient with respect to all parameters to `out`.
    ///
    /// `output_gradient` is the gradient with respect to the output. For each layer, the gradient
    /// with respect to the filters precedes that of the spline coefficients, channel by channel.
    pub fn add_gradient(&self, output_gradient: ArrayView2<'_, F>, out: &mut [f64]) {
        let mut gradient = output_gradient.insert_axis(Axis(0)).to_owned();
        let mut earlier_layers = out;
        for (index, layer) in self.layers.iter().enumerate().rev() {
            if interrupt::is_requested() {
                return;
            }
            if index == 0 {
                gradient = self.data.to_pixels_adjoint(gradient);
            }
            let start = earlier_layers.len() - layer.parameters();
            let (head, parameters) = earlier_layers.split_at_mut(start);
            earlier_layers = head;
            let (filters, coefficients) = parameters.split_at_mut(layer.filters.len());
            self.pull_back_splines(index, &mut gradient, coefficients);
            let Ok(filters) = ArrayViewMut4::from_shape(layer.filters.dim(), filters) else {
                continue;
            };
            if index == 0 {
                self.data.add_tap_gradient(gradient.view(), filters);
            } else {
                self.filter_inputs[index - 1].add_tap_gradient(gradient.view(), filters);
                gradient = layer.adjoint_taps().pull_back(gradient.view());
            }
        }
    }

    /// Replace the gradient with respect to the output of a layer's splines with the gradient with
    /// respect to their input. Add the gradient with respect to their coefficients.
    fn pull_back_splines(
        &self,
        layer: usize,
        gradient: &mut Array3<F>,
        mut coefficients: &mut [f64],
    ) {
        let splines = &self.layers[layer].splines;
        let channels = splines.iter().zip(self.spline_inputs[layer].outer_iter());
        for ((spline, input), mut gradient) in channels.zip(gradient.outer_iter_mut()) {
            let (own, others) = coefficients.split_at_mut(spline.len());
            coefficients = others;
            if let (Some(input), Some(gradient)) = (input.as_slice(), gradient.as_slice_mut()) {
                spline.pull_back(input, gradient, own);
            }
        }
    }
}
