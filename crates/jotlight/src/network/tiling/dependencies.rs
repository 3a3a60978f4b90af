//! The regions of the layers' outputs on which a region of the image depends.

use super::region::Region;
use crate::network::convolution::filter_taps::input_region;
use crate::network::graph::Graph;
use crate::numbers::Real;

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
        let plane_size = graph.plane_size(index, size);
        let region = regions[index].aligned(upsampling);
        let region = region.with_whole_tiles(layer.tile_side(), plane_size);
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
