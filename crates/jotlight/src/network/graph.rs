//! How layers are put together: what each reads and adds, and how large its planes are.

use super::layer::{Layer, Wiring};
use crate::error::{Error, Result};
use crate::numbers::Real;

/// Rows of a picture that one row of a network's planes may stand for, and the other way round: parts of pictures are no smaller.
const LARGEST_STEP: usize = 256;

/// Numbers of planes at a pixel, times the step: 256 times as many are the least that a part of a picture takes, 1 GiB.
const LARGEST_PART: usize = 1 << 20;

/// Layers in order, checked.
pub(super) struct Graph<'a, F> {
    pub layers: Vec<&'a Layer<F>>,
    /// Which layer each of them reads; the first reads the data.
    pub sources: Vec<usize>,
    /// The last layer that takes the planes of each.
    pub last_use: Vec<usize>,
    /// Rows of the picture for so many of a layer's planes: (picture, planes).
    scales: Vec<(usize, usize)>,
    /// What rows and columns of the planes of the first layer have to be a multiple of.
    pub step: usize,
    /// Numbers of the largest planes for a pixel.
    pub numbers: usize,
}

impl<'a, F: Real> Graph<'a, F> {
    /// Checks that each layer reads and adds planes that fit, and that the last gives one plane of the picture's own size.
    ///
    /// # Errors
    /// [`Error::Shape`] and [`Error::Range`] when something does not fit.
    pub fn new(layers: &[&'a Layer<F>]) -> Result<Self> {
        let mut graph = Self {
            layers: layers.to_vec(),
            sources: vec![0],
            last_use: vec![0; layers.len()],
            scales: vec![(1, 1)],
            step: 1,
            numbers: layers.first().map_or(0, |layer| layer.channels()),
        };
        let Some((first, last)) = layers.first().zip(layers.last()) else {
            return Err(Error::range("layers", "at least one", 0));
        };
        if first.wiring != Wiring::default() {
            let expected = "no stride, upsampling or kept planes in the first";
            return Err(Error::range("layers", expected, "some"));
        }
        for (index, layer) in layers.iter().enumerate().skip(1) {
            let source = layer.wiring.reads.unwrap_or(index - 1);
            for number in [Some(source), layer.wiring.adds].into_iter().flatten() {
                if number >= index {
                    let expected = "one before the layer that reads it";
                    return Err(Error::range("layer that is read", expected, number));
                }
                graph.last_use[number] = index;
            }
            let (inputs, channels) = (layer.filters.dim().1, layers[source].channels());
            if inputs != channels {
                return Err(Error::shape("input channels of a layer", channels, inputs));
            }
            let (above, below) = graph.scales[source];
            // What filters with a stride give has whole rows, before any are made of its depth.
            let (above, below) = reduced(above * layer.wiring.stride, below);
            graph.step = graph.step / greatest_divisor(graph.step, above) * above;
            let scale = reduced(above, below * layer.wiring.upsampling);
            if graph.step.max(scale.1) > LARGEST_STEP {
                let expected = "strides and upsamplings of at most 256 together";
                return Err(Error::range("layers", expected, graph.step.max(scale.1)));
            }
            if let Some(kept) = layer.wiring.adds {
                let expected = (layer.channels(), scale);
                let given = (layers[kept].channels(), graph.scales[kept]);
                if given != expected {
                    return Err(Error::shape("kept planes", expected, given));
                }
            }
            let numbers = layer.channels() * scale.1 * scale.1;
            graph.numbers = graph.numbers.max(numbers.div_ceil(scale.0 * scale.0));
            graph.sources.push(source);
            graph.scales.push(scale);
        }
        if graph.numbers * graph.step > LARGEST_PART {
            let expected = "at most 2^20 numbers at a pixel, times the strides";
            let given = graph.numbers * graph.step;
            return Err(Error::range("layers", expected, given));
        }
        if let Some(unused) = graph.last_use[..layers.len() - 1]
            .iter()
            .position(|&by| by == 0)
        {
            return Err(Error::range(
                "layers",
                "planes that another one takes",
                unused,
            ));
        }
        if (last.channels(), graph.scales.last()) != (1, Some(&(1, 1))) {
            let expected = "1, of the size of the picture";
            return Err(Error::shape(
                "output channels of the last layer",
                expected,
                last.channels(),
            ));
        }
        Ok(graph)
    }

    /// Rows and columns of a layer's planes, for those of the picture, which are multiples of the step.
    pub fn size(&self, layer: usize, (rows, columns): (usize, usize)) -> (usize, usize) {
        let (above, below) = self.scales[layer];
        (rows / above * below, columns / above * below)
    }
}

fn reduced(above: usize, below: usize) -> (usize, usize) {
    let divisor = greatest_divisor(above, below);
    (above / divisor, below / divisor)
}

fn greatest_divisor(a: usize, b: usize) -> usize {
    if b == 0 {
        a
    } else {
        greatest_divisor(b, a % b)
    }
}

/// Checks that each layer reads what the one before it gives, and that the last gives one plane.
pub(super) fn check_chain<F: Real>(layers: &[Layer<F>]) -> Result<()> {
    let Some(last) = layers.last() else {
        return Err(Error::range("layers", "at least one", 0));
    };
    let plain = |layer: &Layer<F>| layer.wiring == Wiring::default() && !layer.splines.is_empty();
    if !layers.iter().all(plain) {
        let expected = "each to read the one before, and splines in all of them";
        return Err(Error::range("layers", expected, "others"));
    }
    for (before, layer) in layers.iter().zip(&layers[1..]) {
        let (outputs, inputs) = (before.filters.dim().0, layer.filters.dim().1);
        if inputs != outputs {
            return Err(Error::shape("input channels of a layer", outputs, inputs));
        }
    }
    if last.filters.dim().0 != 1 {
        return Err(Error::shape(
            "output channels of the last layer",
            1,
            last.filters.dim().0,
        ));
    }
    Ok(())
}
