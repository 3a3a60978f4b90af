//! The Jacobian of a picture: what each parameter changes in it, equation (15), forward through the layers.

use ndarray::{Array3, s};

use crate::network::convolution::adjoint::Padded;
use crate::network::training::backward::Trace;
use crate::numbers::Real;

impl<F: Real> Trace<'_, F> {
    /// dĉ/da for all parameters a, in the order of [`Trace::backward`], as rows over the `pixels` of the picture that are wanted.
    /// A parameter that changes nothing there is left out: its index is not among the first list.
    pub fn jacobian(&self, pixels: &[usize]) -> (Vec<usize>, Vec<F>) {
        let mut rows = Rows {
            pixels,
            indices: Vec::new(),
            values: Vec::new(),
        };
        let mut index = 0;
        for (depth, layer) in self.layers.iter().enumerate() {
            let (channels, inputs, lines, columns) = layer.filters.dim();
            for channel in 0..channels {
                let mut visit = |number: usize, plane: &[F]| {
                    let tangent = self.bent(depth, channel, plane);
                    rows.add(index + number, &self.push(depth, tangent));
                };
                if depth == 0 {
                    self.blocks
                        .each_tap((inputs, lines, columns), |[t, i, j], plane| {
                            visit((t * lines + i) * columns + j, plane);
                        });
                } else {
                    self.padded[depth - 1].each_tap((inputs, lines, columns), &mut visit);
                }
                index += inputs * lines * columns;
            }
            for (channel, spline) in layer.splines.iter().enumerate() {
                let input = self.inputs[depth].index_axis(ndarray::Axis(0), channel);
                let shares: Vec<_> = input.iter().map(|&z| spline.weights(z)).collect();
                for number in 0..spline.len() {
                    let mut tangent = Array3::zeros(self.inputs[depth].dim());
                    let mut any = false;
                    let mut plane = tangent.index_axis_mut(ndarray::Axis(0), channel);
                    for (value, (first, weights)) in plane.iter_mut().zip(&shares) {
                        if let Some(&weight) =
                            number.checked_sub(*first).and_then(|k| weights.get(k))
                        {
                            *value = weight;
                            any = true;
                        }
                    }
                    if any {
                        rows.add(index + number, &self.push(depth, tangent));
                    }
                }
                index += spline.len();
            }
        }
        (rows.indices, rows.values)
    }

    /// From what changes in one channel's input of the splines to what changes in their outputs.
    fn bent(&self, depth: usize, channel: usize, plane: &[F]) -> Array3<F> {
        let inputs = &self.inputs[depth];
        let spline = &self.layers[depth].splines[channel];
        let mut tangent = Array3::zeros(inputs.dim());
        let outputs = tangent.slice_mut(s![channel, .., ..]).into_iter();
        for ((out, &z), &change) in outputs.zip(inputs.slice(s![channel, .., ..])).zip(plane) {
            *out = spline.slope(z) * change;
        }
        tangent
    }

    /// From what changes in the outputs of a layer to what changes in the picture.
    fn push(&self, depth: usize, mut tangent: Array3<F>) -> Array3<F> {
        if depth == 0 {
            tangent = self.blocks.spread(tangent);
        }
        for (layer, inputs) in self.layers.iter().zip(&self.inputs).skip(depth + 1) {
            tangent = Padded::mirrored(tangent.view(), layer.taps()).convolved(layer.taps());
            let channels = layer.splines.iter().zip(inputs.outer_iter());
            for ((spline, input), mut tangent) in channels.zip(tangent.outer_iter_mut()) {
                tangent.zip_mut_with(&input, |change, &z| *change *= spline.slope(z));
            }
        }
        tangent
    }
}

struct Rows<'a, F> {
    pixels: &'a [usize],
    indices: Vec<usize>,
    values: Vec<F>,
}

impl<F: Real> Rows<'_, F> {
    fn add(&mut self, index: usize, picture: &Array3<F>) {
        let Some(picture) = picture.as_slice() else {
            return;
        };
        let start = self.values.len();
        self.values
            .extend(self.pixels.iter().map(|&pixel| picture[pixel]));
        if self.values[start..].iter().all(|x| *x == F::zero()) {
            self.values.truncate(start);
        } else {
            self.indices.push(index);
        }
    }
}
