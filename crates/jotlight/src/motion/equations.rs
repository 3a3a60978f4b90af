//! The normal equations of the displacement errors of all tiles.

use std::borrow::Cow;

use ndarray::{Array3, ArrayView1, ArrayView3, Axis};
use rayon::prelude::*;

use super::brightness::checked_ratio;
use super::count::{Count, Counts};
use super::lines::BLOCK;
use super::sums::{Sums, check_remainders, check_shapes};
use super::template::{SHARE_OF_TEMPLATE, Template};
use crate::bits::contiguous;
use crate::border::mirror_index;
use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::filter::filter_twice;
use crate::interrupt;

/// The width of a tile in pixels.
pub const TILE: usize = 16;

// The remainders of a tile in a row are those of one block of pixels.
const _: () = assert!(TILE == BLOCK);

/// The number of sums of a tile: three of A, and two of b.
const SUMS: usize = 5;

/// The normal equations A e = b of the displacement errors e of all tiles.
#[derive(Clone, Debug)]
pub struct Equations {
    /// A, `(3, rows, columns)`: the entries for rows, for rows and columns, and for columns.
    pub information: Array3<f64>,
    /// b, `(2, rows, columns)`: for rows and columns.
    pub right: Array3<f64>,
}

/// A view of [`Equations`].
#[derive(Clone, Copy, Debug)]
pub struct EquationsView<'a> {
    /// A, `(3, rows, columns)`.
    pub information: ArrayView3<'a, f64>,
    /// b, `(2, rows, columns)`.
    pub right: ArrayView3<'a, f64>,
}

impl EquationsView<'_> {
    /// Check the shapes and the values, and return the numbers of rows and columns of tiles.
    pub(super) fn check(&self) -> Result<(usize, usize)> {
        let (_, rows, columns) = self.right.dim();
        let right = (2, rows.max(1), columns.max(1));
        if self.right.dim() != right {
            return Err(Error::shape(
                "right sides of the equations",
                right,
                self.right.dim(),
            ));
        }
        let information = (3, rows, columns);
        if self.information.dim() != information {
            let received = self.information.dim();
            return Err(Error::shape(
                "information of the equations",
                information,
                received,
            ));
        }
        let values = self.information.iter().chain(&self.right);
        match values.clone().find(|value| !value.is_finite()) {
            Some(value) => Err(Error::range("equations", "finite numbers", value)),
            None => Ok((rows, columns)),
        }
    }

    /// Return A of each tile.
    pub(super) fn information_of_tiles(&self) -> Vec<[f64; 3]> {
        let [a, b, c] = [0, 1, 2].map(|k| self.information.index_axis_move(Axis(0), k));
        let entries = a.iter().zip(b.iter().zip(&c));
        entries.map(|(&a, (&b, &c))| [a, b, c]).collect()
    }
}

/// Return the normal equations of the displacement errors of a block of frames.
///
/// The ones N of the block are expected to be D p(x + e), with the filtered probabilities p of the
/// template. With the filter G, g = ∇p, and the mean remainders r̄, the residual counts are
/// ρ = G N/β − (G D)(p + g · r̄), and their weights are w = 1/\[p(1 − p)(1 + 0.35 D/D_R)\], or 0 where
/// D is 0. β is the brightness of the block, the ratio of Σ N to Σ D p. The equations are
/// A = Σ w D g gᵀ and b = Σ w ρ g, summed over tiles of [`TILE`] pixels.
///
/// Wide filters leave no details between neighboring rows. So of 2 rows, one is compared if the
/// width of the filter is 1 or more, and of 4 rows if it is 2 or more. It stands for all of them.
/// In images of less than 65,536 pixels, all rows are compared.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if counts are not
/// possible, or a remainder is not finite.
pub fn normal_equations<C: Count>(template: &Template, sums: Sums<'_, C>) -> Result<Equations> {
    check_shapes(sums.ones, sums.trials, template.size)?;
    check_remainders(sums.remainders, template.size)?;
    let (rows, columns) = template.size;
    let row = |row: usize| Cow::Borrowed(&template.probability[row * template.stride..][..columns]);
    let counts = [Counts {
        ones: sums.ones,
        trials: sums.trials,
    }];
    let per_one = 1.0 / checked_ratio(&counts, row)? as f32;
    let tiles = (rows.div_ceil(TILE), columns.div_ceil(TILE));
    let mut rows_of_tiles = vec![vec![[0.0; SUMS]; tiles.1]; tiles.0];
    rows_of_tiles
        .par_iter_mut()
        .enumerate()
        .for_each(|(index, out)| {
            if !interrupt::is_requested() {
                add_row_of_tiles(template, sums, per_one, index, out);
            }
        });
    let entries = |first: usize, number| {
        Array3::from_shape_fn((number, tiles.0, tiles.1), |(entry, row, column)| {
            rows_of_tiles[row][column][first + entry]
        })
    };
    Ok(Equations {
        information: entries(0, 3),
        right: entries(3, 2),
    })
}

levels! {
    /// Add the sums of a row of tiles to `out`.
    fn add_row_of_tiles[C: Count](
        template: &Template,
        sums: Sums<'_, C>,
        per_one: f32,
        index: usize,
        out: &mut [[f64; SUMS]],
    ) = add_row_of_tiles_inlined;
}

#[inline(always)]
fn add_row_of_tiles_inlined<C: Count>(
    template: &Template,
    sums: Sums<'_, C>,
    per_one: f32,
    index: usize,
    out: &mut [[f64; SUMS]],
) {
    let (size, stride, radius) = (template.size, template.stride, template.taps.len() / 2);
    let top = index * TILE;
    let in_tile = TILE.min(size.0 - top);
    // The row in the middle of those for which it stands.
    let first = top + (template.step.min(in_tile) - 1) / 2;
    let step = template.step;
    let compared = (top + in_tile - first).div_ceil(step);
    let rows = (compared - 1) * step + 1;
    let share = in_tile as f32 / compared as f32;
    let mut planes = gather(sums, first, rows, radius, stride);
    for ones in &mut planes[0] {
        *ones *= per_one;
    }
    let filtered = planes.each_ref().map(|plane| {
        let mut out = vec![0.0; compared * stride];
        filter_twice(plane, step, &template.taps, &mut out, size.1);
        out
    });
    let per_frame = 1.0 / sums.frames.max(1) as f32;
    let mut lanes = vec![[[0.0; TILE]; SUMS]; out.len()];
    for index in 0..compared {
        let row = index * step;
        let trials = &planes[1][(row + radius) * stride..][..stride];
        let start = (first + row) * stride;
        let planes = [
            &template.probability[start..],
            &template.gradient[0][start..],
            &template.gradient[1][start..],
            &template.trials[start..],
            trials,
            &filtered[0][index * stride..],
            &filtered[1][index * stride..],
        ];
        let planes = planes.map(|plane| &plane.as_chunks::<TILE>().0[..out.len()]);
        for (tile, lanes) in lanes.iter_mut().enumerate() {
            let remainders = [
                per_frame * sums.remainders[[first + row, 0, tile]],
                per_frame * sums.remainders[[first + row, 1, tile]],
            ];
            // The compiler does not inline functions that map arrays.
            let [p, rows, columns, of_template, trials, ones, filtered] = planes;
            let of_template = [&p[tile], &rows[tile], &columns[tile], &of_template[tile]];
            let counts = [&trials[tile], &ones[tile], &filtered[tile]];
            add_pixels(lanes, of_template, counts, remainders);
        }
    }
    for (out, lanes) in out.iter_mut().zip(&lanes) {
        *out = lanes.map(|sums| {
            let sum: f64 = sums.iter().copied().map(f64::from).sum();
            f64::from(share) * sum
        });
    }
}

/// Return the rows of N and D that a row of tiles reads. Rows outside the image are reflected.
#[inline(always)]
fn gather<C: Count>(
    sums: Sums<'_, C>,
    first: usize,
    rows: usize,
    radius: usize,
    stride: usize,
) -> [Vec<f32>; 2] {
    let (height, width) = sums.ones.dim();
    let length = (rows + 2 * radius) * stride;
    let mut planes = [(); 2].map(|()| vec![0.0; length]);
    let [ones, trials] = &mut planes;
    for index in 0..rows + 2 * radius {
        let row = mirror_index((first + index) as isize - radius as isize, height);
        let range = index * stride..index * stride + width;
        convert(sums.ones.row(row), &mut ones[range.clone()]);
        convert(sums.trials.row(row), &mut trials[range]);
    }
    planes
}

/// Convert the counts of a row.
#[inline(always)]
fn convert<C: Count>(counts: ArrayView1<'_, C>, out: &mut [f32]) {
    for (out, &count) in out.iter_mut().zip(contiguous(counts).iter()) {
        *out = count.to_f32();
    }
}

/// Add the terms of the pixels of a row of a tile to its sums.
#[inline(always)]
fn add_pixels(
    sums: &mut [[f32; TILE]; SUMS],
    [p, rows, columns, of_template]: [&[f32; TILE]; 4],
    [trials, ones, filtered_trials]: [&[f32; TILE]; 3],
    [along_rows, along_columns]: [f32; 2],
) {
    for i in 0..TILE {
        let expected = p[i] + rows[i] * along_rows + columns[i] * along_columns;
        let residual = ones[i] - filtered_trials[i] * expected;
        let variance = p[i] * (1.0 - p[i]) * (of_template[i] + SHARE_OF_TEMPLATE * trials[i]);
        let weight = of_template[i] / variance;
        let weight = if trials[i] > 0.0 { weight } else { 0.0 };
        let information = weight * trials[i];
        let residual = weight * residual;
        sums[0][i] += information * rows[i] * rows[i];
        sums[1][i] += information * rows[i] * columns[i];
        sums[2][i] += information * columns[i] * columns[i];
        sums[3][i] += residual * rows[i];
        sums[4][i] += residual * columns[i];
    }
}
