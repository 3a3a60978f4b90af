//! The graph of a network: the connections between its layers, and the resolutions of their planes.

use num_integer::Integer;

use super::layer::{Layer, Wiring};
use crate::error::{Error, Result};
use crate::numbers::Real;

/// The maximum of `Graph::size_divisor`, and of the resolution of a plane relative to the image.
const MAX_SCALE: usize = 256;

/// The maximum of `Graph::values_per_pixel` × `Graph::size_divisor`. The smallest tile holds 256 ×
/// 2²⁰ values at this maximum, which take 1 GiB as `f32`.
const MAX_VALUES_TIMES_DIVISOR: usize = 1 << 20;

/// Layers in order of evaluation, with checked connections.
pub(super) struct Graph<'a, F> {
    pub layers: Vec<&'a Layer<F>>,
    /// For each layer, the index of the layer whose output its filters read. The entry of the first
    /// layer has no meaning, because this layer reads the bits or counts.
    pub inputs: Vec<usize>,
    /// For each layer, the index of the last layer that uses its output.
    pub last_use: Vec<usize>,
    scales: Vec<Scale>,
    /// The divisor of the height and the width of the first layer's planes. Strides would otherwise
    /// lead to planes with fractions of pixels.
    pub size_divisor: usize,
    /// The maximum number of values per image pixel in the output of any layer.
    pub values_per_pixel: usize,
}

/// The resolution of a layer's planes, as a reduced fraction: `plane` rows of a plane cover `image`
/// rows of the image. The same holds for columns.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scale {
    image: usize,
    plane: usize,
}

impl Scale {
    fn reduced(image: usize, plane: usize) -> Self {
        let divisor = image.gcd(&plane);
        Self {
            image: image / divisor,
            plane: plane / divisor,
        }
    }
}

impl<'a, F: Real> Graph<'a, F> {
    /// Return the graph of the layers.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] if a layer reads or adds planes of the wrong shape, if
    /// no layer uses the output of a layer, if the network is too large, or if the last layer does
    /// not return planes of the image's size.
    pub fn new(layers: &[&'a Layer<F>]) -> Result<Self> {
        let Some(first) = layers.first() else {
            return Err(Error::range("layers", "at least one", 0));
        };
        if first.wiring != Wiring::default() {
            let expected = "no stride, upsampling, input, or skip connection";
            return Err(Error::range("first layer", expected, "at least one"));
        }
        let mut graph = Self {
            layers: layers.to_vec(),
            inputs: vec![0],
            last_use: vec![0; layers.len()],
            scales: vec![Scale { image: 1, plane: 1 }],
            size_divisor: 1,
            values_per_pixel: first.channels(),
        };
        for index in 1..layers.len() {
            graph.connect(index)?;
        }
        let values = graph.values_per_pixel * graph.size_divisor;
        if values > MAX_VALUES_TIMES_DIVISOR {
            let what = "values per pixel times the combined stride";
            return Err(Error::range(what, "at most 2^20", values));
        }
        let others = &graph.last_use[..layers.len() - 1];
        if let Some(unused) = others.iter().position(|&user| user == 0) {
            let expected = "a later layer to use the output of each layer";
            let received = format!("an unused output of the layer with index {unused}");
            return Err(Error::range("layers", expected, received));
        }
        if graph.scales.last() != Some(&Scale { image: 1, plane: 1 }) {
            let expected = format_args!("planes of the size of the image");
            let received = format_args!("another size");
            return Err(Error::shape("output of the last layer", expected, received));
        }
        Ok(graph)
    }

    /// Check the connections of a layer, and record its input and the resolution of its output.
    fn connect(&mut self, index: usize) -> Result<()> {
        let layer = self.layers[index];
        let input = layer.wiring.input.unwrap_or(index - 1);
        for other in [Some(input), layer.wiring.skip].into_iter().flatten() {
            if other >= index {
                let expected = "the index of an earlier layer";
                return Err(Error::range("input or skip of a layer", expected, other));
            }
            self.last_use[other] = index;
        }
        let (read, channels) = (layer.filters.dim().1, self.layers[input].channels());
        if read != channels {
            return Err(Error::shape("input channels of a layer", channels, read));
        }
        let scale = self.scales[input];
        // A filter with a stride must compute whole rows. The depth-to-space rearrangement
        // multiplies them only afterwards, so it is left out here.
        let strided = Scale::reduced(scale.image * layer.wiring.stride, scale.plane);
        self.size_divisor = self.size_divisor.lcm(&strided.image);
        let scale = Scale::reduced(strided.image, strided.plane * layer.wiring.upsampling);
        let largest = self.size_divisor.max(scale.plane);
        if largest > MAX_SCALE {
            let expected = "strides and upsamplings of at most 256 together";
            return Err(Error::range("layers", expected, largest));
        }
        if let Some(skip) = layer.wiring.skip {
            let expected = (layer.channels(), scale);
            let received = (self.layers[skip].channels(), self.scales[skip]);
            if received != expected {
                let describe = |(channels, scale): (usize, Scale)| {
                    let Scale { image, plane } = scale;
                    format!("{channels} channels with {plane} rows per {image} rows of the image")
                };
                return Err(Error::Shape {
                    what: "skip connection",
                    expected: describe(expected),
                    received: describe(received),
                });
            }
        }
        let values = layer.channels() * scale.plane * scale.plane;
        let values_per_pixel = values.div_ceil(scale.image * scale.image);
        self.values_per_pixel = self.values_per_pixel.max(values_per_pixel);
        self.inputs.push(input);
        self.scales.push(scale);
        Ok(())
    }

    /// Return the number of planes that the network computes.
    pub fn channels(&self) -> usize {
        self.layers.last().map_or(0, |last| last.channels())
    }

    /// Return the number of rows and of columns of a layer's planes.
    ///
    /// The height and the width of the image must be multiples of `size_divisor`.
    pub fn plane_size(&self, layer: usize, (height, width): (usize, usize)) -> (usize, usize) {
        let Scale { image, plane } = self.scales[layer];
        (height / image * plane, width / image * plane)
    }
}

/// Check that each layer reads the previous layer and has splines, and that the last layer returns
/// one plane. Training supports only these networks.
pub(super) fn check_sequential<F: Real>(layers: &[Layer<F>]) -> Result<()> {
    let Some(last) = layers.last() else {
        return Err(Error::range("layers", "at least one", 0));
    };
    let plain = |layer: &Layer<F>| layer.wiring == Wiring::default() && !layer.splines.is_empty();
    if !layers.iter().all(plain) {
        let expected = "layers that read the previous layer and have splines";
        return Err(Error::range("layers", expected, "another kind of layer"));
    }
    for (previous, layer) in layers.iter().zip(&layers[1..]) {
        let (outputs, inputs) = (previous.filters.dim().0, layer.filters.dim().1);
        if inputs != outputs {
            return Err(Error::shape("input channels of a layer", outputs, inputs));
        }
    }
    let outputs = last.filters.dim().0;
    if outputs != 1 {
        return Err(Error::shape(
            "output channels of the last layer",
            1,
            outputs,
        ));
    }
    Ok(())
}
