//! From the sums of the first layer to a picture.

use std::ops::Range;

use ndarray::{Array2, Array3, ArrayView2, ArrayView3};
use rayon::prelude::*;

use super::block::{check_block, masked_filter};
use super::codes::{Tables, block_filter};
use super::look_up::Table;
use super::lsi::{Padded, Part, in_one_piece};
use super::{Layer, Real, check_chain};
use crate::bits::{PackedBits, check_mask};
use crate::error::{Error, Result};

/// Pixels of a band: some tens of microseconds of work, and planes that stay near the core.
const BAND: usize = 1 << 15;
/// Rows of a band, unless there are many threads: those around it are worked on for both it and its neighbour.
const LEAST: usize = 32;

/// The linear part of a first layer, p of equation (11), one plane per filter. `valid` is a packed mask of the jots that count;
/// where some do not, the others stand for them, and a pixel without any becomes NaN.
///
/// # Errors
/// [`Error::Shape`] when bits, mask and the layer's filters `(C, T, K̂, K̂)` do not fit.
pub fn block_sums<F: Real>(
    layer: &Layer<F>,
    bits: &PackedBits<'_>,
    valid: Option<ArrayView2<'_, u8>>,
) -> Result<Array3<F>> {
    let pixels = check_block(layer.filters(), bits)?;
    let (_, rows, columns) = bits.shape();
    check_mask(valid, rows, columns)?;
    Ok(match valid {
        None => block_filter(bits, layer.filters(), pixels),
        Some(valid) => masked_filter(bits, valid, layer.filters(), pixels),
    })
}

/// The network's picture from the sums p of its first layer, `(C, H, W)`: equations (10), (9), (8), and so on for further layers.
///
/// # Errors
/// [`Error::Shape`] when layers, filters and sums do not fit.
pub fn forward<F: Real>(layers: &[Layer<F>], sums: ArrayView3<'_, F>) -> Result<Array2<F>> {
    let (channels, height, width) = sums.dim();
    check(layers, channels, (height, width))?;
    let sums = in_one_piece(sums);
    Ok(picture(layers, (height, width), |rows, out| {
        let planes = sums.chunks_exact(height * width);
        for (out, sums) in out.chunks_exact_mut(rows.len() * width).zip(planes) {
            out.copy_from_slice(&sums[rows.start * width..rows.end * width]);
        }
        layers[0].bend(out);
    }))
}

/// The same where p is one of a few: `sums` `(C, K + 1)` has it for each count.
///
/// # Errors
/// [`Error::Shape`] when layers, filters and sums do not fit, [`Error::Range`] for a count without a sum.
pub fn forward_counts<F: Real>(
    layers: &[Layer<F>],
    counts: ArrayView2<'_, i32>,
    sums: ArrayView2<'_, F>,
) -> Result<Array2<F>> {
    let (channels, number) = sums.dim();
    check(layers, channels, counts.dim())?;
    let (height, width) = counts.dim();
    let counts = in_one_piece(counts);
    // A negative count is a large one here.
    let most = |counts: &[i32]| {
        let counts = counts.iter().map(|count| count.cast_unsigned());
        counts.fold(0, u32::max)
    };
    let most = counts.par_chunks(BAND).map(most).max().unwrap_or(0);
    if most as usize >= number {
        return Err(Error::range("counts", "those that have a sum", "others"));
    }
    let mut tables: Vec<F> = sums.iter().copied().collect();
    layers[0].bend(&mut tables);
    let tables: Vec<_> = tables.chunks_exact(number).map(Table::new).collect();
    Ok(picture(layers, (height, width), |rows, out| {
        let planes = out.chunks_exact_mut(rows.len() * width);
        let counts = &counts[rows.start * width..rows.end * width];
        for (out, table) in planes.zip(&tables) {
            table.look_up(counts, out);
        }
    }))
}

/// The same from bits, whose jots the first layer weighs singly with its filters `(C, T, K̂, K̂)`.
///
/// # Errors
/// [`Error::Shape`] when layers, filters and bits do not fit.
pub fn forward_bits<F: Real>(layers: &[Layer<F>], bits: &PackedBits<'_>) -> Result<Array2<F>> {
    check_chain(layers)?;
    let first = &layers[0];
    let (height, width) = check_block(first.filters(), bits)?;
    let mut tables = Tables::new(first.filters(), height * width);
    let bent = tables.bend(first.splines());
    Ok(picture(layers, (height, width), |rows, out| {
        tables.fill(bits, rows, width, out);
        if !bent {
            first.bend(out);
        }
    }))
}

fn check<F: Real>(
    layers: &[Layer<F>],
    planes: usize,
    (height, width): (usize, usize),
) -> Result<()> {
    check_chain(layers)?;
    let expected = layers[0].splines.len();
    if planes != expected || height * width == 0 {
        let given = (planes, height, width);
        return Err(Error::shape("planes of the first layer", expected, given));
    }
    Ok(())
}

/// What a thread works on.
#[derive(Default)]
struct Scratch<F> {
    planes: Vec<F>,
    padded: Padded<F>,
}

/// The picture in bands of rows, each through all layers while it is near the core. `first` fills some rows of the planes `(C, rows, W)`
/// that the first layer gives.
fn picture<F: Real>(
    layers: &[Layer<F>],
    (height, width): (usize, usize),
    first: impl Fn(Range<usize>, &mut [F]) + Sync,
) -> Array2<F> {
    let mut picture = Array2::zeros((height, width));
    // As many for each thread.
    let bands = (height * width).div_ceil(BAND).min(height.div_ceil(LEAST));
    let bands = bands.next_multiple_of(rayon::current_num_threads());
    let rows = height.div_ceil(bands).next_multiple_of(4);
    let pixels = picture.as_slice_mut().unwrap_or_default();
    pixels
        .par_chunks_mut(rows * width)
        .enumerate()
        .for_each_init(Scratch::default, |scratch, (band, out)| {
            let Scratch { planes, padded } = scratch;
            let start = band * rows;
            // The rows that each layer has to give, found from the last one on.
            let mut given = start..start + out.len() / width;
            let mut wanted = Vec::with_capacity(layers.len());
            for layer in layers[1..].iter().rev() {
                let read = layer.taps.rows_read(&given, height);
                wanted.push((layer, std::mem::replace(&mut given, read)));
            }
            planes.resize(layers[0].splines.len() * given.len() * width, F::zero());
            first(given.clone(), planes);
            while let Some((layer, wanted)) = wanted.pop() {
                let part = Part {
                    planes,
                    rows: std::mem::replace(&mut given, wanted.clone()),
                    height,
                    width,
                };
                padded.fill(&part, &wanted, &layer.taps);
                planes.resize(layer.splines.len() * wanted.len() * width, F::zero());
                padded.convolve(&layer.taps, planes);
                layer.bend(planes);
            }
            out.copy_from_slice(planes);
        });
    picture
}
