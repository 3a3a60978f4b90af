//! Counts of blocks of frames, added where they agree with a template.

use ndarray::{Array2, ArrayView2, ArrayViewMut2, Axis};
use rayon::prelude::*;

use super::block_sums::{accept_row, add, check_sums};
use super::brightness::brightness_of_blocks;
use super::chi_squared::{Comparison, ROWS_PER_TASK, test_band};
use super::count::Counts;
use crate::bits::{contiguous, packed_width};
use crate::error::{Error, Result, check_shape};
use crate::interrupt;

/// Which counts agree with a template.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// χ² of each pixel is below this limit.
    pub chi_squared: f32,
    /// The brightness differs from 1 by at most this number.
    pub change: f64,
}

/// A block of frames, and its neighbors that are compared with the template together with it.
#[derive(Clone, Debug)]
pub struct Tested<'a> {
    /// The counts of the block and of its neighbors.
    pub near: Vec<Counts<'a>>,
    /// The index of the block among them.
    pub own: usize,
}

/// The sums to which accepted counts are added, and where they are.
#[derive(Debug)]
pub struct Totals<'a> {
    /// The numbers of ones, and of trials, that are accepted, `(H, W)`.
    pub accepted: [ArrayViewMut2<'a, i32>; 2],
    /// The number of trials of all counts, `(H, W)`.
    pub available: ArrayViewMut2<'a, i32>,
    /// The packed pixels of each block that are accepted, `(H, ⌈W/8⌉)`.
    pub masks: Vec<ArrayViewMut2<'a, u8>>,
}

/// Add the counts of blocks to the totals where χ² of the comparison of each block and its neighbors with
/// a template is below a limit, and write these pixels into its mask.
///
/// Blocks whose brightness is that of a change of the light are left out. Return whether each block
/// is not left out.
///
/// # Errors
/// Those of [`super::chi_squared`], and [`Error::Range`] if a total exceeds the `i32`. After the
/// latter error, the totals are incomplete.
pub fn accept_agreeing<'a>(
    (probability, trials_of_template): (ArrayView2<'a, f32>, ArrayView2<'a, i32>),
    limits: Limits,
    blocks: &'a [Tested<'a>],
    totals: Totals<'_>,
) -> Result<Vec<bool>> {
    let near: Vec<_> = blocks.iter().map(|block| &block.near[..]).collect();
    let brightness = brightness_of_blocks(&near, probability, trials_of_template)?;
    check_totals(probability.dim(), blocks, &totals)?;
    let Totals {
        accepted: [mut ones, mut trials],
        mut available,
        mut masks,
    } = totals;
    let is_same = |&brightness: &f64| (brightness - 1.0).abs() <= limits.change;
    let is_same: Vec<_> = brightness.iter().map(is_same).collect();
    let compare = |index: usize| {
        let comparison = Comparison {
            parts: near[index],
            probability,
            trials_of_template,
        };
        (
            comparison,
            1.0 / brightness[index] as f32,
            blocks[index].own,
        )
    };
    let indices = (0..blocks.len()).filter(|&index| is_same[index]);
    let tested: Vec<_> = indices.map(compare).collect();
    let masks = masks.iter_mut().zip(&is_same).filter(|&(_, &same)| same);
    let masks = divide_masks(masks.map(|(mask, _)| mask), probability.nrows());
    let bands = ones
        .axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK)
        .into_par_iter()
        .zip(trials.axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK))
        .zip(available.axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK))
        .zip(masks);
    // All blocks of a band, one after the other: the rows of neighbors stay in the cache.
    bands.enumerate().try_for_each(
        |(band, (((mut ones, mut trials), mut available), masks))| {
            let mut signs = 0;
            let first = band * ROWS_PER_TASK;
            let mut test = Array2::zeros(ones.dim());
            for ((comparison, per_one, own), mask) in tested.iter().zip(masks) {
                if interrupt::is_requested() {
                    return Ok(());
                }
                test_band(comparison, *per_one, first, test.view_mut());
                let (sums, own) = (
                    [ones.view_mut(), trials.view_mut()],
                    &comparison.parts[*own],
                );
                let test = (test.view(), limits.chi_squared);
                accept_band(test, (own, first), sums, mask, &mut signs);
                for (row, mut available) in (first..).zip(available.rows_mut()) {
                    add(&contiguous(own.trials.row(row)), &mut available, &mut signs);
                }
            }
            check_sums(signs)
        },
    )?;
    Ok(is_same)
}

/// Return the parts of all masks in each band of rows.
fn divide_masks<'a, 'b: 'a>(
    masks: impl Iterator<Item = &'a mut ArrayViewMut2<'b, u8>>,
    rows: usize,
) -> Vec<Vec<ArrayViewMut2<'a, u8>>> {
    let bands = rows.div_ceil(ROWS_PER_TASK);
    let mut divided: Vec<Vec<_>> = (0..bands).map(|_| Vec::new()).collect();
    for mask in masks {
        let parts = mask.axis_chunks_iter_mut(Axis(0), ROWS_PER_TASK);
        let pairs = divided.iter_mut().zip(parts);
        pairs.for_each(|(masks, part)| masks.push(part));
    }
    divided
}

/// Check that totals have the shape of an image, and a mask for each block.
fn check_totals(size: (usize, usize), blocks: &[Tested<'_>], totals: &Totals<'_>) -> Result<()> {
    let [ones, trials] = &totals.accepted;
    for shape in [ones.dim(), trials.dim(), totals.available.dim()] {
        check_shape("counts", size, shape)?;
    }
    if totals.masks.len() != blocks.len() {
        return Err(Error::shape("masks", blocks.len(), totals.masks.len()));
    }
    for (block, mask) in blocks.iter().zip(&totals.masks) {
        check_shape("packed mask", (size.0, packed_width(size.1)), mask.dim())?;
        if block.own >= block.near.len() {
            let expected = format!("below {}", block.near.len());
            return Err(Error::range("index of the block", expected, block.own));
        }
    }
    Ok(())
}

/// Add the counts of some rows whose value in a test is below a limit, and pack these pixels.
fn accept_band(
    (test, limit): (ArrayView2<'_, f32>, f32),
    (block, first): (&Counts<'_>, usize),
    sums: [ArrayViewMut2<'_, i32>; 2],
    mut mask: ArrayViewMut2<'_, u8>,
    signs: &mut i32,
) {
    let [mut ones, mut trials] = sums;
    let mut bytes = vec![0; mask.ncols()];
    for (index, test) in test.rows().into_iter().enumerate() {
        let row = first + index;
        let counts = [block.ones.row(row), block.trials.row(row)];
        let sums = [ones.row_mut(index), trials.row_mut(index)];
        accept_row(&contiguous(test), limit, counts, sums, &mut bytes, signs);
        let mut mask = mask.row_mut(index);
        mask.iter_mut()
            .zip(&bytes)
            .for_each(|(byte, &value)| *byte = value);
    }
}
