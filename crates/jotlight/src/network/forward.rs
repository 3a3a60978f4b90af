//! The forward pass: from bits, counts, or sums p to an image (equations (8) to (11)).

use ndarray::{Array2, Array3, ArrayView2, ArrayView3};
use rayon::prelude::*;

use super::first_layer::bit_tables::BitTables;
use super::first_layer::count_table::CountTable;
use super::first_layer::masked::filter_masked_bits;
use super::first_layer::pixel_grid;
use super::graph::Graph;
use super::layer::Layer;
use super::tiling::region::Region;
use super::tiling::schedule::evaluate_in_tiles;
use super::tiling::strips::{PlanesMut, contiguous_planes};
use crate::bits::{PackedBits, check_mask};
use crate::error::{Error, Result};
use crate::numbers::Real;

/// The number of counts that a parallel task checks.
const COUNTS_PER_TASK: usize = 1 << 16;

/// Return the sums p of equation (11) from bits with dead jots, one plane per filter.
///
/// `valid` is a packed mask of the jots that are not dead. The mean of the valid bits of a pixel
/// replaces the bits of its dead jots. A pixel without a valid jot is NaN.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the bits, the mask, and the filters `(C, T, K̂, K̂)` do not
/// match. [`Error::Range`] if K̂ does not divide the height and the width of the bits.
pub fn masked_sums<F: Real>(
    layer: &Layer<F>,
    bits: &PackedBits<'_>,
    valid: ArrayView2<'_, u8>,
) -> Result<Array3<F>> {
    let pixels = pixel_grid(layer.filters(), bits)?;
    let (_, rows, columns) = bits.shape();
    check_mask(Some(valid), rows, columns)?;
    filter_masked_bits(bits, valid, layer.filters(), pixels)
}

/// Return the image that the network computes from the sums p of its first layer.
///
/// The shape of `sums` is `(C, H, W)`. For a network of two layers, the function evaluates
/// equations (10), (9), and (8), in this order. A network may have more layers.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers and the sums do not match.
pub fn forward<F: Real>(layers: &[&Layer<F>], sums: ArrayView3<'_, F>) -> Result<Array2<F>> {
    let (channels, height, width) = sums.dim();
    let graph = checked_graph(layers, channels, (height, width))?;
    let sums = contiguous_planes("sums", sums)?;
    evaluate_in_tiles(&graph, (height, width), |region, out| {
        for (plane, sums) in sums.chunks_exact(height * width).enumerate() {
            for (row, sums) in rows_of_region(sums, region, width).enumerate() {
                out.row(plane, row).copy_from_slice(sums);
            }
        }
        layers[0].activate(out);
    })
}

/// Return the image that the network computes from counts.
///
/// `sums` holds the sum p of the first layer for each count from 0 to K. Its shape is `(C, K + 1)`.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers, the counts, and the sums do not match.
/// [`Error::Range`] for a count outside 0 to K.
pub fn forward_counts<F: Real>(
    layers: &[&Layer<F>],
    counts: ArrayView2<'_, i32>,
    sums: ArrayView2<'_, F>,
) -> Result<Array2<F>> {
    let (channels, length) = sums.dim();
    let graph = checked_graph(layers, channels, counts.dim())?;
    let (height, width) = counts.dim();
    let counts = contiguous_planes("counts", counts)?;
    // A negative count becomes a large unsigned number, so one comparison detects counts below 0
    // and above K.
    let max = |counts: &[i32]| {
        let counts = counts.iter().map(|count| count.cast_unsigned());
        counts.fold(0, u32::max)
    };
    let max = counts.par_chunks(COUNTS_PER_TASK).map(max).max();
    if max.unwrap_or(0) as usize >= length {
        return Err(Error::range(
            "counts",
            "counts with a sum",
            "a count without a sum",
        ));
    }
    let mut tables = contiguous_planes("sums", sums)?.into_owned();
    layers[0].activate(&mut PlanesMut::contiguous(&mut tables, (1, length)));
    let tables: Vec<_> = tables.chunks_exact(length).map(CountTable::new).collect();
    evaluate_in_tiles(&graph, (height, width), |region, out| {
        for (plane, table) in tables.iter().enumerate() {
            for (row, counts) in rows_of_region(&counts, region, width).enumerate() {
                table.look_up(counts, out.row(plane, row));
            }
        }
    })
}

/// Return the image that the network computes from bits.
///
/// The filters of the first layer must have the shape `(C, T, K̂, K̂)`.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers and the bits do not match.
pub fn forward_bits<F: Real>(layers: &[&Layer<F>], bits: &PackedBits<'_>) -> Result<Array2<F>> {
    let (graph, first) = (Graph::new(layers)?, layers[0]);
    let (height, width) = pixel_grid(first.filters(), bits)?;
    check_planes(first.channels(), first.channels(), (height, width))?;
    let mut tables = BitTables::new(first.filters(), height * width);
    let activated = tables.activate(first.splines());
    evaluate_in_tiles(&graph, (height, width), |region, out| {
        tables.filter(bits, region, out);
        if !activated {
            first.activate(out);
        }
    })
}

/// Return the rows of a region of a plane.
fn rows_of_region<'a, T>(
    plane: &'a [T],
    region: &'a Region,
    width: usize,
) -> impl Iterator<Item = &'a [T]> {
    let rows = plane.chunks_exact(width).skip(region.rows.start);
    rows.take(region.rows.len())
        .map(|row| &row[region.columns.clone()])
}

/// Return the graph of the layers. Check that the first layer has `planes` output planes, and that
/// the planes are not empty.
fn checked_graph<'a, F: Real>(
    layers: &[&'a Layer<F>],
    planes: usize,
    size: (usize, usize),
) -> Result<Graph<'a, F>> {
    let graph = Graph::new(layers)?;
    check_planes(layers[0].channels(), planes, size)?;
    Ok(graph)
}

fn check_planes(channels: usize, planes: usize, (height, width): (usize, usize)) -> Result<()> {
    if planes != channels || height == 0 || width == 0 {
        let expected = format!("{channels} planes with at least one pixel");
        let received = (planes, height, width);
        return Err(Error::Shape {
            what: "planes of the first layer",
            expected,
            received: format!("{received:?}"),
        });
    }
    Ok(())
}
