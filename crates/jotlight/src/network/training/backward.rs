//! Error backpropagation: the gradient of the cost of one picture by a reverse sweep, equations (14) to (19) for two layers.

use ndarray::{Array3, ArrayView2, ArrayViewMut4, Axis};

use crate::network::convolution::adjoint::{Padded, push_to_planes};
use crate::network::first_layer::block::Blocks;
use crate::network::layer::Layer;
use crate::numbers::Real;

/// A forward run that remembers what the sweep back needs.
pub(crate) struct Trace<'a, F> {
    pub layers: &'a [Layer<F>],
    pub blocks: &'a Blocks<'a>,
    /// What the filters of every layer but the first read.
    pub padded: Vec<Padded<F>>,
    /// What the splines of every layer read.
    pub inputs: Vec<Array3<F>>,
    /// ĉ, `(1, H, W)`.
    pub output: Array3<F>,
}

impl<'a, F: Real> Trace<'a, F> {
    /// The layers fit each other and the blocks.
    pub fn new(layers: &'a [Layer<F>], blocks: &'a Blocks<'a>) -> Self {
        let mut padded = Vec::with_capacity(layers.len());
        let mut inputs = Vec::with_capacity(layers.len());
        let mut planes = Array3::default((0, 0, 0));
        for (index, layer) in layers.iter().enumerate() {
            let filtered = if index == 0 {
                blocks.filtered(layer.filters())
            } else {
                let mirrored = Padded::mirrored(planes.view(), layer.taps());
                let filtered = mirrored.convolved(layer.taps());
                padded.push(mirrored);
                filtered
            };
            planes.clone_from(&filtered);
            if let Some(planes) = planes.as_slice_mut() {
                layer.bend(planes);
            }
            if index == 0 {
                planes = blocks.spread(planes);
            }
            inputs.push(filtered);
        }
        Self {
            layers,
            blocks,
            padded,
            inputs,
            output: planes,
        }
    }

    /// Adds the gradient with respect to all parameters, given that of the output, to `out`: of every layer the filters, then
    /// the coefficients, channel by channel.
    pub fn backward(&self, of_output: ArrayView2<'_, F>, out: &mut [f64]) {
        let mut gradient = of_output.insert_axis(Axis(0)).to_owned();
        let mut rest = out;
        for (index, layer) in self.layers.iter().enumerate().rev() {
            if index == 0 {
                gradient = self.blocks.gather(gradient);
            }
            let (head, mine) = rest.split_at_mut(rest.len() - layer.parameters());
            rest = head;
            let (of_filters, mut of_coefficients) = mine.split_at_mut(layer.filters.len());
            let channels = layer.splines.iter().zip(self.inputs[index].outer_iter());
            for ((spline, input), mut gradient) in channels.zip(gradient.outer_iter_mut()) {
                let (bins, further) = of_coefficients.split_at_mut(spline.len());
                of_coefficients = further;
                if let (Some(input), Some(gradient)) = (input.as_slice(), gradient.as_slice_mut()) {
                    spline.push(input, gradient, bins);
                }
            }
            let Ok(of_filters) = ArrayViewMut4::from_shape(layer.filters.dim(), of_filters) else {
                continue;
            };
            if index == 0 {
                self.blocks.push_to_taps(gradient.view(), of_filters);
            } else {
                self.padded[index - 1].push_to_taps(gradient.view(), of_filters);
                gradient = push_to_planes(layer.turned(), gradient.view());
            }
        }
    }
}
