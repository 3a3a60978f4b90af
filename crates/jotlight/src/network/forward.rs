//! The forward pass: from the data of the first layer to an image.

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
use super::tiling::strips::contiguous_planes;
use crate::bits::{PackedBits, check_mask};
use crate::error::{Error, Result};
use crate::numbers::Real;

/// The number of counts that a parallel task compares.
const COUNTS_PER_TASK: usize = 1 << 16;

/// Return the filtered bits p of equation (11) where some jots are dead, one plane per filter.
///
/// `valid` is a packed mask of the jots that are not dead. The mean of a pixel's valid jots
/// replaces its dead jots. A pixel without a valid jot is NaN.
///
/// # Errors
/// [`Error::Shape`] if bits, mask, and the layer's filters `(C, T, K̂, K̂)` do not fit.
pub fn masked_sums<F: Real>(
    layer: &Layer<F>,
    bits: &PackedBits<'_>,
    valid: ArrayView2<'_, u8>,
) -> Result<Array3<F>> {
    let pixels = pixel_grid(layer.filters(), bits)?;
    let (_, rows, columns) = bits.shape();
    check_mask(Some(valid), rows, columns)?;
    Ok(filter_masked_bits(bits, valid, layer.filters(), pixels))
}

/// Return the image that the network computes from the sums p of its first layer, `(C, H, W)`:
/// equations (10), (9), (8), and so on for further layers.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if layers, filters, and sums do not fit.
pub fn forward<F: Real>(layers: &[&Layer<F>], sums: ArrayView3<'_, F>) -> Result<Array2<F>> {
    let (channels, height, width) = sums.dim();
    let graph = checked_graph(layers, channels, (height, width))?;
    let sums = contiguous_planes(sums);
    Ok(evaluate_in_tiles(&graph, (height, width), |region, out| {
        let planes = sums.chunks_exact(height * width);
        for (out, sums) in out.chunks_exact_mut(region.pixels()).zip(planes) {
            for (out, sums) in rows_of_region(out, sums, region, width) {
                out.copy_from_slice(sums);
            }
        }
        layers[0].activate(out);
    }))
}

/// Return the image that the network computes from counts, where `sums` `(C, K + 1)` is the first
/// layer's p for each count.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if layers, filters, and sums do not fit. [`Error::Range`]
/// for a count without a sum.
pub fn forward_counts<F: Real>(
    layers: &[&Layer<F>],
    counts: ArrayView2<'_, i32>,
    sums: ArrayView2<'_, F>,
) -> Result<Array2<F>> {
    let (channels, length) = sums.dim();
    let graph = checked_graph(layers, channels, counts.dim())?;
    let (height, width) = counts.dim();
    let counts = contiguous_planes(counts);
    // A negative count becomes a large unsigned one, so one comparison finds both.
    let max = |counts: &[i32]| {
        let counts = counts.iter().map(|count| count.cast_unsigned());
        counts.fold(0, u32::max)
    };
    let max = counts.par_chunks(COUNTS_PER_TASK).map(max).max();
    if max.unwrap_or(0) as usize >= length {
        return Err(Error::range("counts", "those that have a sum", "others"));
    }
    let mut tables: Vec<F> = sums.iter().copied().collect();
    layers[0].activate(&mut tables);
    let tables: Vec<_> = tables.chunks_exact(length).map(CountTable::new).collect();
    Ok(evaluate_in_tiles(&graph, (height, width), |region, out| {
        for (out, table) in out.chunks_exact_mut(region.pixels()).zip(&tables) {
            for (out, counts) in rows_of_region(out, &counts, region, width) {
                table.look_up(counts, out);
            }
        }
    }))
}

/// Return the image that the network computes from bits. Its first layer has filters
/// `(C, T, K̂, K̂)`.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if layers, filters, and bits do not fit.
pub fn forward_bits<F: Real>(layers: &[&Layer<F>], bits: &PackedBits<'_>) -> Result<Array2<F>> {
    let graph = Graph::new(layers)?;
    let first = layers[0];
    let (height, width) = pixel_grid(first.filters(), bits)?;
    let mut tables = BitTables::new(first.filters(), height * width);
    let activated = tables.activate(first.splines());
    Ok(evaluate_in_tiles(&graph, (height, width), |region, out| {
        tables.filter(bits, region, out);
        if !activated {
            first.activate(out);
        }
    }))
}

/// Return the rows of a region of a plane, each with the same row of the whole plane.
fn rows_of_region<'a, A, B>(
    part: &'a mut [A],
    whole: &'a [B],
    region: &'a Region,
    width: usize,
) -> impl Iterator<Item = (&'a mut [A], &'a [B])> {
    let rows = whole.chunks_exact(width).skip(region.rows.start);
    part.chunks_exact_mut(region.columns.len())
        .zip(rows)
        .map(|(part, row)| (part, &row[region.columns.clone()]))
}

/// Return the graph of the layers, after a check that the first layer's planes fit.
fn checked_graph<'a, F: Real>(
    layers: &[&'a Layer<F>],
    planes: usize,
    (height, width): (usize, usize),
) -> Result<Graph<'a, F>> {
    let graph = Graph::new(layers)?;
    let channels = layers[0].channels();
    if planes != channels || height * width == 0 {
        let received = (planes, height, width);
        return Err(Error::shape(
            "planes of the first layer",
            channels,
            received,
        ));
    }
    Ok(graph)
}
