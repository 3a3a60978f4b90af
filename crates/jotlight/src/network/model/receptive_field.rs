//! The radius of the receptive field.

use crate::error::Result;
use crate::network::graph::Graph;
use crate::network::layer::Layer;

/// The rows of a plane from the first one to the one before the second.
type Rows = (isize, isize);

/// Return the radius of the receptive field of layers in pixels, a multiple of the size divisor.
///
/// The tiles of the image are larger, because convolutions compute squares of pixels. A halo of
/// whole squares would not begin at a multiple of the size divisor.
pub(super) fn radius(layers: &[&Layer<f32>]) -> Result<usize> {
    let graph = Graph::new(layers)?;
    let step = graph.size_divisor as isize;
    // The rows of each layer's output on which `step` rows of the image depend; same for columns.
    let mut needed: Vec<Option<Rows>> = vec![None; layers.len()];
    if let Some(last) = needed.last_mut() {
        *last = Some((0, step));
    }
    let include = |needed: &mut Vec<Option<Rows>>, layer: usize, part: Rows| {
        let (low, high) = needed[layer].unwrap_or(part);
        needed[layer] = Some((low.min(part.0), high.max(part.1)));
    };
    for (index, layer) in layers.iter().enumerate().skip(1).rev() {
        let Some((start, end)) = needed[index] else {
            continue;
        };
        let upsampling = layer.wiring.upsampling as isize;
        let first = start.div_euclid(upsampling);
        let last = -(-end).div_euclid(upsampling);
        let stride = layer.wiring.stride as isize;
        let (_, _, rows, columns) = layer.filters().dim();
        for taps in [rows as isize, columns as isize] {
            let padding = (taps - stride) / 2;
            let part = (first * stride, (last - 1) * stride + taps);
            include(
                &mut needed,
                graph.inputs[index],
                (part.0 - padding, part.1 - padding),
            );
        }
        if let Some(skip) = layer.wiring.skip {
            include(&mut needed, skip, (first * upsampling, last * upsampling));
        }
    }
    let (start, end) = needed.first().copied().flatten().unwrap_or((0, step));
    let radius = (-start).max(end - step).max(0).cast_unsigned();
    Ok(radius.next_multiple_of(graph.size_divisor))
}
