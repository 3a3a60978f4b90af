//! The regions of each layer that a region of the network's output depends on.

use std::ops::Range;

use super::region::Region;
use crate::error::Result;
use crate::network::convolution::filter_taps::input_region;
use crate::network::convolution::winograd::OUTPUT_ROWS;
use crate::network::graph::Graph;
use crate::network::layer::Layer;
use crate::numbers::Real;

/// Return the rows of the data that a network needs to compute some rows of the image.
///
/// The network returns the same values for these rows alone as for the whole data.
///
/// # Errors
/// [`crate::error::Error`] if the layers do not fit each other.
pub fn input_rows<F: Real>(
    layers: &[&Layer<F>],
    height: usize,
    rows: Range<usize>,
) -> Result<Range<usize>> {
    let graph = Graph::new(layers)?;
    // Layers compute rows in groups. A part must have the same groups as the whole.
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
    // Rows beyond the last one mirror the rows above it.
    let start = start.min(height.saturating_sub(end.saturating_sub(height)));
    Ok(start / group * group..end.next_multiple_of(group).min(height))
}

/// Return the region that each layer must compute for a region of the last layer's output.
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
