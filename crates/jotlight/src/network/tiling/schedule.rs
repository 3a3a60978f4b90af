//! The division of an image into bands for the threads, and of the bands into tiles.

use std::ops::Range;

use rayon::prelude::*;

use super::dependencies::required_regions;
use super::region::Region;
use super::strips::PlanesMut;
use super::workspace::{CachedWorkspace, TileColumn};
use crate::interrupt;
use crate::network::convolution::winograd::TILE;
use crate::network::graph::Graph;
use crate::numbers::Real;

/// The maximum number of pixels of a tile, or of each strip if threads share the tile.
const MAX_TILE_PIXELS: usize = 1 << 16;
/// The maximum number of bytes in the planes of a layer of a tile, or of each strip, unless one row
/// of Winograd tiles has more. The planes that a layer reads and writes, and its transformed values,
/// then fit into a second-level cache of 1 or 2 MiB.
const MAX_LAYER_BYTES: usize = 320 << 10;
/// The maximum number of values in the planes of a tile.
const MAX_TILE_VALUES: usize = 1 << 22;
/// The maximum width of a tile.
const MAX_TILE_WIDTH: usize = 1024;
/// The minimum width of a tile. A tile should be much wider than the halo that it reads.
const MIN_TILE_WIDTH: usize = 64;
/// The minimum height of a band, in heights of the receptive field. It bounds the fraction of rows
/// that two bands both compute.
const MIN_BAND_HEIGHT: usize = 2;
/// The minimum height of a band in the same unit, if a thread has several.
const MIN_SHORT_BAND_HEIGHT: usize = 8;
/// The maximum number of bands per thread. If there are several, no thread waits long for another.
const BANDS_PER_THREAD: usize = 4;
/// The number of strips per thread if threads share a tile.
const STRIPS_PER_THREAD: usize = 2;

/// Write the planes that a network computes into `image`, plane after plane, and row after row.
///
/// `first_layer` writes a region of the first layer's output.
pub(crate) fn evaluate_in_tiles<F: Real>(
    graph: &Graph<'_, F>,
    size: (usize, usize),
    image: &mut [F],
    first_layer: impl Fn(&Region, &mut PlanesMut<'_, F>) + Sync,
) {
    let (height, width) = size;
    let (bands, strips) = divide_among_threads(graph, height);
    let group = TILE * graph.size_divisor;
    let values = graph.values_per_pixel;
    let pixels = MAX_TILE_PIXELS.min(MAX_TILE_VALUES / values);
    let tile_width = (pixels / group).clamp(MIN_TILE_WIDTH, MAX_TILE_WIDTH);
    let cached_pixels = pixels.min(MAX_LAYER_BYTES / (values * size_of::<F>()));
    let bands = split_into_bands(image, size, bands, group);
    bands.into_par_iter().for_each_init(
        CachedWorkspace::default,
        |CachedWorkspace(workspace), (rows, mut out)| {
            for left in (0..width).step_by(tile_width) {
                if interrupt::is_requested() {
                    return;
                }
                let columns = left..(left + tile_width).min(width);
                let tile_height = strips * cached_pixels / columns.len().max(MIN_TILE_WIDTH);
                let tile_height = (tile_height / group * group).max(group);
                let tiles = rows.clone().step_by(tile_height).map(|top| Region {
                    rows: top..(top + tile_height).min(rows.end),
                    columns: columns.clone(),
                });
                let column = TileColumn::new(graph, size, strips, &first_layer);
                column.evaluate(workspace, tiles, |region, planes| {
                    for (plane, out) in out.iter_mut().enumerate() {
                        let out = &mut out[(region.rows.start - rows.start) * width..];
                        for (row, out) in region.rows.clone().zip(out.chunks_exact_mut(width)) {
                            let row = &planes.row(row).plane(plane)[left - planes.columns.start..];
                            out[columns.clone()].copy_from_slice(&row[..columns.len()]);
                        }
                    }
                });
            }
        },
    );
}

/// Divide an image into bands of almost equal heights, which begin at multiples of `group` rows.
///
/// Each band has its rows of each plane.
fn split_into_bands<F>(
    image: &mut [F],
    (height, width): (usize, usize),
    number: usize,
    group: usize,
) -> Vec<(Range<usize>, Vec<&mut [F]>)> {
    let start = |band: usize| {
        let groups = (2 * band * height + number * group) / (2 * number * group);
        if band == number {
            height
        } else {
            (groups * group).min(height)
        }
    };
    let bands = (0..number).map(|band| start(band)..start(band + 1));
    let mut bands: Vec<_> = bands
        .filter(|rows| !rows.is_empty())
        .map(|rows| (rows, Vec::new()))
        .collect();
    for mut plane in image.chunks_exact_mut(height * width) {
        for (rows, parts) in &mut bands {
            let (part, rest) = plane.split_at_mut(rows.len() * width);
            parts.push(part);
            plane = rest;
        }
    }
    bands
}

/// Return the number of bands, and the number of strips per tile.
///
/// Each thread computes bands. If the image has too few rows for one band per thread, several
/// threads share a band, and compute the strips of each tile at the same time.
fn divide_among_threads<F: Real>(graph: &Graph<'_, F>, height: usize) -> (usize, usize) {
    let threads = rayon::current_num_threads();
    if threads == 1 {
        return (1, 1);
    }
    // The receptive field of a row far from the borders of a large image is complete.
    let start = graph.size_divisor << 16;
    let row = Region {
        rows: start..start + graph.size_divisor,
        columns: 0..1,
    };
    let receptive_field = required_regions(graph, (2 * start, 2 * start), &row)[0]
        .rows
        .len();
    let max_bands = height / (MIN_BAND_HEIGHT * receptive_field);
    if max_bands < threads {
        let bands = max_bands.max(1);
        (bands, (STRIPS_PER_THREAD * threads).div_ceil(bands))
    } else {
        let short_bands = height / (MIN_SHORT_BAND_HEIGHT * receptive_field);
        (
            threads * (short_bands / threads).clamp(1, BANDS_PER_THREAD),
            1,
        )
    }
}
