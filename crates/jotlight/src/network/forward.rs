//! From the sums of the first layer to a picture.

use ndarray::{Array2, Array3, ArrayView2, ArrayView3};
use rayon::prelude::*;

use crate::bits::{PackedBits, check_mask};
use crate::error::{Error, Result};
use crate::network::convolution::adjoint::in_one_piece;
use crate::network::first_layer::bit_tables::Tables;
use crate::network::first_layer::block::{check_block, masked_filter};
use crate::network::first_layer::count_table::Table;
use crate::network::graph::Graph;
use crate::network::layer::Layer;
use crate::network::tiling::region::Place;
use crate::network::tiling::workspace::picture;
use crate::numbers::Real;

/// Counts that are looked through at a time.
const STRETCH: usize = 1 << 16;

/// The linear part of a first layer where some jots are dead, p of equation (11), one plane per filter. `valid` is a packed mask of the jots that
/// count; these stand for the others, and a pixel without any becomes NaN.
///
/// # Errors
/// [`Error::Shape`] when bits, mask and the layer's filters `(C, T, K̂, K̂)` do not fit.
pub fn masked_sums<F: Real>(
    layer: &Layer<F>,
    bits: &PackedBits<'_>,
    valid: ArrayView2<'_, u8>,
) -> Result<Array3<F>> {
    let pixels = check_block(layer.filters(), bits)?;
    let (_, rows, columns) = bits.shape();
    check_mask(Some(valid), rows, columns)?;
    Ok(masked_filter(bits, valid, layer.filters(), pixels))
}

/// The network's picture from the sums p of its first layer, `(C, H, W)`: equations (10), (9), (8), and so on for further layers.
///
/// # Errors
/// [`Error::Shape`] when layers, filters and sums do not fit.
pub fn forward<F: Real>(layers: &[&Layer<F>], sums: ArrayView3<'_, F>) -> Result<Array2<F>> {
    let (channels, height, width) = sums.dim();
    let graph = check(layers, channels, (height, width))?;
    let sums = in_one_piece(sums);
    Ok(picture(&graph, (height, width), |place, out| {
        let planes = sums.chunks_exact(height * width);
        for (out, sums) in out.chunks_exact_mut(place.pixels()).zip(planes) {
            for (out, sums) in rows_of(out, sums, place, width) {
                out.copy_from_slice(sums);
            }
        }
        layers[0].bend(out);
    }))
}

/// The same where p is one of a few: `sums` `(C, K + 1)` has it for each count.
///
/// # Errors
/// [`Error::Shape`] when layers, filters and sums do not fit, [`Error::Range`] for a count without a sum.
pub fn forward_counts<F: Real>(
    layers: &[&Layer<F>],
    counts: ArrayView2<'_, i32>,
    sums: ArrayView2<'_, F>,
) -> Result<Array2<F>> {
    let (channels, number) = sums.dim();
    let graph = check(layers, channels, counts.dim())?;
    let (height, width) = counts.dim();
    let counts = in_one_piece(counts);
    // A negative count is a large one here.
    let most = |counts: &[i32]| {
        let counts = counts.iter().map(|count| count.cast_unsigned());
        counts.fold(0, u32::max)
    };
    let most = counts.par_chunks(STRETCH).map(most).max().unwrap_or(0);
    if most as usize >= number {
        return Err(Error::range("counts", "those that have a sum", "others"));
    }
    let mut tables: Vec<F> = sums.iter().copied().collect();
    layers[0].bend(&mut tables);
    let tables: Vec<_> = tables.chunks_exact(number).map(Table::new).collect();
    Ok(picture(&graph, (height, width), |place, out| {
        for (out, table) in out.chunks_exact_mut(place.pixels()).zip(&tables) {
            for (out, counts) in rows_of(out, &counts, place, width) {
                table.look_up(counts, out);
            }
        }
    }))
}

/// The same from bits, whose jots the first layer weighs singly with its filters `(C, T, K̂, K̂)`.
///
/// # Errors
/// [`Error::Shape`] when layers, filters and bits do not fit.
pub fn forward_bits<F: Real>(layers: &[&Layer<F>], bits: &PackedBits<'_>) -> Result<Array2<F>> {
    let graph = Graph::new(layers)?;
    let first = layers[0];
    let (height, width) = check_block(first.filters(), bits)?;
    let mut tables = Tables::new(first.filters(), height * width);
    let bent = tables.bend(first.splines());
    Ok(picture(&graph, (height, width), |place, out| {
        tables.fill(bits, place, out);
        if !bent {
            first.bend(out);
        }
    }))
}

/// The rows of a plane of its own that belong to a place, each with those of the whole.
fn rows_of<'a, A, B>(
    part: &'a mut [A],
    whole: &'a [B],
    place: &'a Place,
    width: usize,
) -> impl Iterator<Item = (&'a mut [A], &'a [B])> {
    let rows = whole.chunks_exact(width).skip(place.rows.start);
    part.chunks_exact_mut(place.columns.len())
        .zip(rows)
        .map(|(part, row)| (part, &row[place.columns.clone()]))
}

fn check<'a, F: Real>(
    layers: &[&'a Layer<F>],
    planes: usize,
    (height, width): (usize, usize),
) -> Result<Graph<'a, F>> {
    let graph = Graph::new(layers)?;
    let expected = layers[0].channels();
    if planes != expected || height * width == 0 {
        let given = (planes, height, width);
        return Err(Error::shape("planes of the first layer", expected, given));
    }
    Ok(graph)
}
