//! The forward pass: from bits, counts, or sums p to an image (equations (8) to (11)).
//!
//! The rows of outputs are contiguous, one after the other.

use ndarray::{
    Array3, ArrayView2, ArrayView3, ArrayViewMut, ArrayViewMut2, ArrayViewMut3, Dimension,
};
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
use crate::bits::{PackedBits, check_mask, count_region, trials};
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

/// Write the image that the network computes from the sums p of its first layer into `out`.
///
/// The shape of `sums` is `(C, H, W)`. For a network of two layers, the function evaluates
/// equations (10), (9), and (8), in this order. A network may have more layers.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers, the sums, and `out` do not match, or the rows
/// of `out` are not contiguous.
pub fn forward<F: Real>(
    layers: &[&Layer<F>],
    sums: ArrayView3<'_, F>,
    out: ArrayViewMut2<'_, F>,
) -> Result<()> {
    evaluate_sums(layers, sums, |graph, size| rows_of_image(out, graph, size))
}

/// Write the planes that the network computes from the sums p of its first layer into `out`.
///
/// The shape of `sums` is `(C, H, W)`, and that of `out` begins with the channels of the last layer.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers, the sums, and `out` do not match, or the rows
/// of `out` are not contiguous.
pub fn forward_planes<F: Real>(
    layers: &[&Layer<F>],
    sums: ArrayView3<'_, F>,
    out: ArrayViewMut3<'_, F>,
) -> Result<()> {
    evaluate_sums(layers, sums, |graph, (height, width)| {
        contiguous_rows(out, (graph.channels(), height, width))
    })
}

/// Write the output of the last layer to `rows` of the graph and the size of a plane.
fn evaluate_sums<'a, F: Real>(
    layers: &[&Layer<F>],
    sums: ArrayView3<'_, F>,
    rows: impl FnOnce(&Graph<'_, F>, (usize, usize)) -> Result<&'a mut [F]>,
) -> Result<()> {
    let (channels, height, width) = sums.dim();
    let graph = checked_graph(layers, channels, (height, width))?;
    let out = rows(&graph, (height, width))?;
    let sums = contiguous_planes("sums", sums)?;
    evaluate_in_tiles(&graph, (height, width), out, |region, out| {
        for (plane, sums) in sums.chunks_exact(height * width).enumerate() {
            for (row, sums) in rows_of_region(sums, region, width).enumerate() {
                out.row(plane, row).copy_from_slice(sums);
            }
        }
        layers[0].activate(out);
    });
    Ok(())
}

/// Write the image that the network computes from counts into `out`.
///
/// `sums` holds the sum p of the first layer for each count from 0 to K. Its shape is `(C, K + 1)`.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers, the counts, the sums, and `out` do not
/// match, or the rows of `out` are not contiguous. [`Error::Range`] for a count outside 0 to K.
pub fn forward_counts<F: Real>(
    layers: &[&Layer<F>],
    counts: ArrayView2<'_, i32>,
    sums: ArrayView2<'_, F>,
    out: ArrayViewMut2<'_, F>,
) -> Result<()> {
    let (channels, length) = sums.dim();
    let graph = checked_graph(layers, channels, counts.dim())?;
    let (height, width) = counts.dim();
    let out = rows_of_image(out, &graph, (height, width))?;
    let counts = contiguous_planes("counts", counts)?;
    // A negative count becomes a large unsigned number, so one comparison detects counts below 0
    // and above K.
    let max = |counts: &[i32]| {
        let counts = counts.iter().map(|count| count.cast_unsigned());
        counts.fold(0, u32::max)
    };
    let max = counts.par_chunks(COUNTS_PER_TASK).map(max).max();
    check_table(max.unwrap_or(0) as usize, length)?;
    let tables = activated_tables(layers[0], sums)?;
    evaluate_in_tiles(&graph, (height, width), out, |region, out| {
        for (plane, table) in tables.iter().enumerate() {
            for (row, counts) in rows_of_region(&counts, region, width).enumerate() {
                table.look_up(counts, out.row(plane, row));
            }
        }
    });
    Ok(())
}

/// Write the image that a tied network computes from bits into `out`.
///
/// It is the image of [`forward_counts`] for the counts of the bits. They are counted tile by tile,
/// and so stay in the cache.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers, the bits, the sums, and `out` do not match,
/// or the rows of `out` are not contiguous.
pub fn forward_tied_bits<F: Real>(
    layers: &[&Layer<F>],
    bits: &PackedBits<'_>,
    oversampling: usize,
    sums: ArrayView2<'_, F>,
    out: ArrayViewMut2<'_, F>,
) -> Result<()> {
    let (channels, length) = sums.dim();
    let size = bits.pixel_shape(oversampling)?;
    let graph = checked_graph(layers, channels, size)?;
    let out = rows_of_image(out, &graph, size)?;
    let max = trials(bits.shape().0, oversampling)?;
    check_table(max.cast_unsigned() as usize, length)?;
    let tables = activated_tables(layers[0], sums)?;
    evaluate_in_tiles(&graph, size, out, |region, out| {
        let (rows, columns) = (region.rows.clone(), region.columns.clone());
        let (counts, first) = count_region(bits, oversampling, rows, columns);
        let width = counts.ncols();
        let counts = counts.as_slice().unwrap_or_default();
        for (row, counts) in counts.chunks_exact(width).enumerate() {
            for (plane, table) in tables.iter().enumerate() {
                table.look_up(&counts[first..], out.row(plane, row));
            }
        }
    });
    Ok(())
}

/// Write the image that the network computes from bits into `out`.
///
/// The filters of the first layer must have the shape `(C, T, K̂, K̂)`.
///
/// # Errors
/// [`Error::Shape`] and [`Error::Range`] if the layers, the bits, and `out` do not match, or the rows
/// of `out` are not contiguous.
pub fn forward_bits<F: Real>(
    layers: &[&Layer<F>],
    bits: &PackedBits<'_>,
    out: ArrayViewMut2<'_, F>,
) -> Result<()> {
    let (graph, first) = (Graph::new(layers)?, layers[0]);
    let (height, width) = pixel_grid(first.filters(), bits)?;
    check_planes(first.channels(), first.channels(), (height, width))?;
    let out = rows_of_image(out, &graph, (height, width))?;
    let mut tables = BitTables::new(first.filters(), height * width);
    let activated = tables.activate(first.splines());
    evaluate_in_tiles(&graph, (height, width), out, |region, out| {
        tables.filter(bits, region, out);
        if !activated {
            first.activate(out);
        }
    });
    Ok(())
}

/// Return the output of the first layer for each count from 0, one table per channel.
fn activated_tables<F: Real>(
    first: &Layer<F>,
    sums: ArrayView2<'_, F>,
) -> Result<Vec<CountTable<F>>> {
    let length = sums.dim().1;
    let mut tables = contiguous_planes("sums", sums)?.into_owned();
    first.activate(&mut PlanesMut::contiguous(&mut tables, (1, length)));
    Ok(tables.chunks_exact(length).map(CountTable::new).collect())
}

/// Check that a table has an entry for the largest count. Negative counts are large ones here.
fn check_table(max: usize, length: usize) -> Result<()> {
    if max < length {
        return Ok(());
    }
    let received = max
        .try_into()
        .map_or(max as i64, |max: u32| i64::from(max.cast_signed()));
    let expected = format!("0 to {} ones of a pixel", length.saturating_sub(1));
    Err(Error::range("counts", expected, received))
}

/// Return the values of a gray image, row after row. Check its size.
fn rows_of_image<'a, F: Real>(
    out: ArrayViewMut2<'a, F>,
    graph: &Graph<'_, F>,
    size: (usize, usize),
) -> Result<&'a mut [F]> {
    if graph.channels() != 1 {
        let what = "output channels of the last layer";
        return Err(Error::shape(what, 1, graph.channels()));
    }
    contiguous_rows(out, size)
}

/// Return the values of an output, row after row. Check its shape.
fn contiguous_rows<F, D: Dimension>(
    out: ArrayViewMut<'_, F, D>,
    expected: D::Pattern,
) -> Result<&mut [F]> {
    let (received, strides) = (out.dim(), out.strides().to_vec());
    match out.into_slice() {
        Some(rows) if received == expected => Ok(rows),
        _ => Err(Error::layout(expected, received, &strides)),
    }
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
