//! The regions of the layers' outputs on which a region of the image depends.

use std::ops::Range;

use super::region::Region;
use crate::error::{Error, Result};
use crate::network::convolution::filter_taps::input_region;
use crate::network::convolution::winograd::OUTPUT_ROWS;
use crate::network::graph::Graph;
use crate::network::layer::Layer;
use crate::numbers::Real;

/// The maximum height of an image. No memory holds a larger one.
const MAX_HEIGHT: usize = 1 << 40;

/// Return the rows of the input that a network needs to compute a range of rows of the image.
///
/// `height` is the number of rows of the image. From the returned rows alone, the network computes
/// the same values as from the whole input.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers do not match each other. [`Error::Range`] if the
/// range of rows is empty or begins outside the image.
pub fn input_rows<F: Real>(
    layers: &[&Layer<F>],
    height: usize,
    rows: Range<usize>,
) -> Result<Range<usize>> {
    let graph = Graph::new(layers)?;
    if rows.start >= rows.end.min(height) || height > MAX_HEIGHT {
        let expected = format!("a range within 0..{}", height.min(MAX_HEIGHT));
        return Err(Error::range("rows", expected, format!("{rows:?}")));
    }
    // Layers compute rows in groups. The groups of a part must be groups of the whole image too.
    let group = OUTPUT_ROWS * graph.size_divisor;
    let end = rows.end.min(height).next_multiple_of(graph.size_divisor);
    let output = Region {
        rows: rows.start / group * group..end,
        columns: 0..graph.size_divisor,
    };
    let size = (
        height.next_multiple_of(graph.size_divisor),
        graph.size_divisor,
    );
    let Range { start, end } = required_regions(&graph, size, &output)[0].rows;
    // Rows beyond the last one are mirrored rows above it.
    let start = start.min(height.saturating_sub(end.saturating_sub(height)));
    Ok(start / group * group..end.next_multiple_of(group).min(height))
}

/// Return the region of each layer's output that a region of the last layer's output depends on.
///
/// `size` is the size of the image.
pub(super) fn required_regions<F: Real>(
    graph: &Graph<'_, F>,
    size: (usize, usize),
    output: &Region,
) -> Vec<Region> {
    let mut regions = vec![Region::default(); graph.layers.len()];
    if let Some(region) = regions.last_mut() {
        *region = output.clone();
    }
    for (index, layer) in graph.layers.iter().enumerate().skip(1).rev() {
        let upsampling = layer.wiring.upsampling;
        let height = graph.plane_size(index, size).0;
        let region = regions[index].aligned(upsampling);
        let region = region.with_whole_row_groups(row_group(layer), height);
        regions[index] = region.clone();
        if let Some(skip) = layer.wiring.skip {
            regions[skip].include(&region);
        }
        let input = graph.inputs[index];
        let filtered = region.before_upsampling(upsampling);
        let (_, _, rows, columns) = layer.filters.dim();
        let input_size = graph.plane_size(input, size);
        let read = input_region((rows, columns), layer.wiring.stride, &filtered, input_size);
        regions[input].include(&read);
    }
    regions
}

/// Return the number of rows of a layer's output that are computed together.
pub(super) fn row_group<F: Real>(layer: &Layer<F>) -> usize {
    let rows = layer.winograd().map_or(1, |_| OUTPUT_ROWS);
    rows * layer.wiring.upsampling
}
