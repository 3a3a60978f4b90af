//! The buffers of a thread, and the evaluation of a column of tiles with them.

use std::any::Any;
use std::cell::Cell;
use std::ops::Range;

use rayon::prelude::*;

use super::dependencies::required_regions;
use super::region::Region;
use super::strip_workspace::StripWorkspace;
use super::strips::{LayerBuffer, PlanesMut, RowLayout, Strip, StripedPlanes};
use crate::interrupt;
use crate::network::graph::Graph;
use crate::numbers::Real;

/// The buffers of a thread.
#[derive(Default)]
pub(super) struct Workspace<F> {
    /// The strips of each layer's output that other layers or the next tile still need.
    layers: Vec<LayerBuffer<F>>,
    /// Free buffers for reuse.
    free: Vec<Vec<F>>,
    /// The number of free buffers that the current tile has not used. They precede the others.
    idle: usize,
    /// One workspace for each strip of a tile.
    strips: Vec<StripWorkspace<F>>,
}

impl<F: Real> Workspace<F> {
    /// Return a buffer of `length` values. It is a free buffer if one has a suitable size.
    fn buffer(&mut self, length: usize) -> Vec<F> {
        let suitable = length..=2 * length;
        let best = (0..self.free.len())
            .filter(|&index| suitable.contains(&self.free[index].capacity()))
            .min_by_key(|&index| self.free[index].capacity());
        let Some(best) = best else {
            return vec![F::zero(); length];
        };
        self.idle -= usize::from(best < self.idle);
        let mut buffer = self.free.remove(best);
        buffer.resize(length, F::zero());
        buffer
    }

    /// Deallocate the free buffers that the last tile did not use.
    fn drop_idle_buffers(&mut self) {
        self.free.drain(..self.idle);
        self.idle = self.free.len();
    }

    /// Return up to `strips` strips for rows of a layer's output. Their heights are multiples of
    /// `group`, except the last one.
    fn allocate_strips(
        &mut self,
        layout: &RowLayout,
        Range { start, end }: Range<usize>,
        strips: usize,
        group: usize,
    ) -> Vec<Strip<Vec<F>>> {
        let height = (end - start).div_ceil(strips).next_multiple_of(group);
        let rows = (start..end)
            .step_by(height)
            .map(|top| top..(top + height).min(end));
        let strip = |rows: Range<usize>| Strip {
            data: self.buffer(layout.length(rows.len())),
            rows,
        };
        rows.map(strip).collect()
    }

    /// Free the strips of a layer that lie entirely above a row.
    fn free_rows_above(&mut self, layer: usize, row: usize) {
        let strips = &mut self.layers[layer].strips;
        let above = strips.partition_point(|strip| strip.rows.end <= row);
        let freed = strips.drain(..above).map(|strip| strip.data);
        self.free.extend(freed);
    }
}

thread_local! {
    /// The workspace of the thread's last image. It is kept, because the allocation of the buffers
    /// for a small image takes longer than its evaluation.
    static CACHE: Cell<Option<Box<dyn Any>>> = const { Cell::new(None) };
}

/// A workspace from the thread's cache. It returns to the cache when it is dropped.
pub(super) struct CachedWorkspace<F: Real>(pub Workspace<F>);

impl<F: Real> Default for CachedWorkspace<F> {
    fn default() -> Self {
        let cached = CACHE.take().and_then(|cached| cached.downcast().ok());
        Self(cached.map_or_else(Workspace::default, |cached| *cached))
    }
}

impl<F: Real> Drop for CachedWorkspace<F> {
    fn drop(&mut self) {
        CACHE.set(Some(Box::new(std::mem::take(&mut self.0))));
    }
}

/// The evaluation of tiles that lie one below the other.
pub(super) struct TileColumn<'a, F, D> {
    graph: &'a Graph<'a, F>,
    image_size: (usize, usize),
    /// The size of the image, rounded up to multiples of the graph's `size_divisor`.
    padded_size: (usize, usize),
    /// The number of strips per tile. Threads compute them at the same time.
    strips: usize,
    /// A function that writes a region of the first layer's output.
    first_layer: D,
}

impl<'a, F: Real, D: Fn(&Region, &mut PlanesMut<'_, F>) + Sync> TileColumn<'a, F, D> {
    pub fn new(
        graph: &'a Graph<'a, F>,
        image_size: (usize, usize),
        strips: usize,
        first_layer: D,
    ) -> Self {
        let padded_size = (
            image_size.0.next_multiple_of(graph.size_divisor),
            image_size.1.next_multiple_of(graph.size_divisor),
        );
        Self {
            graph,
            image_size,
            padded_size,
            strips,
            first_layer,
        }
    }

    /// Compute the tiles from top to bottom. Call `finish` with each tile and its planes.
    ///
    /// An interruption ends the computation before the next layer.
    pub fn evaluate(
        &self,
        workspace: &mut Workspace<F>,
        tiles: impl Iterator<Item = Region>,
        mut finish: impl FnMut(&Region, &StripedPlanes<'_, F>),
    ) {
        let strips = workspace.strips.len().max(self.strips);
        workspace
            .strips
            .resize_with(strips, StripWorkspace::default);
        workspace.layers.clear();
        let required = |tile| (required_regions(self.graph, self.padded_size, &tile), tile);
        let mut tiles = tiles.map(required).peekable();
        while let Some((regions, tile)) = tiles.next() {
            if workspace.layers.is_empty() {
                workspace
                    .layers
                    .extend(
                        regions
                            .iter()
                            .zip(&self.graph.layers)
                            .map(|(region, layer)| LayerBuffer {
                                strips: Vec::new(),
                                layout: RowLayout::new(region.columns.clone(), layer.channels()),
                            }),
                    );
            }
            let next = tiles.peek().map(|(regions, _)| regions);
            let next_start =
                |layer: usize| next.map_or(usize::MAX, |regions| regions[layer].rows.start);
            for (index, region) in regions.iter().enumerate() {
                self.compute(workspace, index, region);
                if interrupt::is_requested() {
                    return;
                }
                for used in (0..index).filter(|&used| self.graph.last_use[used] == index) {
                    workspace.free_rows_above(used, next_start(used));
                }
            }
            let last = self.graph.layers.len() - 1;
            finish(&tile, &workspace.layers[last].view(self.padded_size));
            workspace.free_rows_above(last, next_start(last));
            workspace.drop_idle_buffers();
        }
    }

    /// Compute the rows of a region of a layer's output that are not in memory.
    fn compute(&self, workspace: &mut Workspace<F>, index: usize, region: &Region) {
        let layer = self.graph.layers[index];
        let last_strip = workspace.layers[index].strips.last();
        let computed_rows = last_strip.map_or(0, |strip| strip.rows.end);
        let missing = computed_rows.max(region.rows.start)..region.rows.end;
        if missing.is_empty() {
            return;
        }
        let layout = workspace.layers[index].layout.clone();
        let mut new_strips =
            workspace.allocate_strips(&layout, missing, self.strips, layer.tile_side());
        let view = |layer: usize| {
            workspace.layers[layer].view(self.graph.plane_size(layer, self.padded_size))
        };
        let input = view(self.graph.inputs[index]);
        let skip = layer.wiring.skip.map(view);
        let workspaces = workspace.strips.par_iter_mut();
        new_strips
            .par_iter_mut()
            .zip(workspaces)
            .for_each(|(strip, workspace)| {
                if interrupt::is_requested() {
                    return;
                }
                let region = Region {
                    rows: strip.rows.clone(),
                    columns: region.columns.clone(),
                };
                let mut out = layout.planes_mut(strip);
                if index == 0 {
                    let (size, channels) = (self.image_size, layer.channels());
                    let first_layer = &self.first_layer;
                    workspace.mirror_first_layer(first_layer, size, channels, &region, &mut out);
                } else {
                    workspace.compute(layer, &input, skip.as_ref(), &region, &mut out);
                }
            });
        workspace.layers[index].strips.extend(new_strips);
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array4;

    use super::*;
    use crate::error::Result;
    use crate::network::layer::{Layer, Wiring};

    #[test]
    fn the_number_of_buffers_does_not_grow_from_tile_to_tile() -> Result<()> {
        let layer = || {
            let ones = Array4::from_elem((1, 1, 3, 3), 1f32);
            Layer::new(ones, None, 0.0, 1.0, Wiring::default())
        };
        let layers = [layer()?, layer()?, layer()?, layer()?];
        let graph = Graph::new(&layers.each_ref())?;
        let mut workspace = Workspace::default();
        let mut free_buffers = || {
            let tiles = [Region::whole((8, 8))].into_iter();
            let ones = |_: &Region, out: &mut PlanesMut<'_, f32>| {
                (0..out.height).for_each(|row| out.row(0, row).fill(1.0));
            };
            TileColumn::new(&graph, (8, 8), 2, ones).evaluate(&mut workspace, tiles, |_, _| ());
            workspace.free.len()
        };
        let first = free_buffers();
        for _ in 0..20 {
            assert!(free_buffers() <= first + 1);
        }
        Ok(())
    }
}
