//! The remainders of counts whose motion changes.

use ndarray::{Array3, ArrayView3, Zip, s};

use super::columns::interval;
use super::equations::TILE;
use super::sums::check_remainders;
use crate::error::{Error, Result};

/// Return the remainders of the same counts along a changed motion, `(H, 2, columns)`.
///
/// `change` `(2, rows, columns)` is by how much the displacements of the centers of tiles increase in
/// each of a number of frames. Along rows, a block of pixels has the displacement of the center of
/// its tile.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if a remainder is not
/// finite.
pub fn changed_remainders(
    remainders: ArrayView3<'_, f32>,
    change: ArrayView3<'_, f64>,
    frames: usize,
) -> Result<Array3<f32>> {
    let (height, directions, columns) = remainders.dim();
    let shape = (2, height.div_ceil(TILE), columns);
    if change.dim() != shape || directions != 2 {
        return Err(Error::shape("change of tiles", shape, change.dim()));
    }
    check_remainders(remainders, (height, columns * TILE))?;
    let change = change.mapv(|value| value as f32);
    let frames = frames as f32;
    let mut changed = remainders.to_owned();
    for (row, mut rows) in changed.outer_iter_mut().enumerate() {
        let (index, fraction) = interval(row, TILE, shape.1);
        let next = (index + 1).min(shape.1 - 1);
        for (k, mut values) in rows.outer_iter_mut().enumerate() {
            let [start, next] = [index, next].map(|index| change.slice(s![k, index, ..]));
            Zip::from(&mut values)
                .and(start)
                .and(next)
                .for_each(|value, &start, &next| {
                    *value -= frames * (start + fraction * (next - start));
                });
        }
    }
    Ok(changed)
}
