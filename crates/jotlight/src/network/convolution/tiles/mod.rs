//! Convolution, equation (9), with 3 × 3 filters of bfloat16 by products of tiles, as AMX computes
//! them.
//!
//! A tile has up to 16 rows of 64 bytes. A product of tiles adds the products of filters, one row
//! for each output, and planes, one row for each pair of inputs, to sums of `f32`.
//!
//! `block` convolves a block of columns. `amx` holds the instructions of the processor, which is the
//! only `unsafe` code of the crate. Tests also emulate them.

// Other processors and systems have no such instructions.
#[cfg_attr(
    not(all(target_arch = "x86_64", target_os = "linux")),
    path = "unavailable.rs"
)]
mod amx;
mod block;
#[cfg(test)]
mod tests;

use ndarray::ArrayView4;

use self::amx::Amx;
pub(crate) use self::block::TileWorkspace;
use super::winograd::{Finish, MIN_INPUTS, MIN_OUTPUTS};
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::{PlanesMut, StripedPlanes};
use crate::numbers::Real;

/// The number of rows and of columns of a filter.
const FILTER_SIZE: usize = 3;
/// The number of words of 32 bits in a row of a tile, and the maximum number of rows.
const SIDE: usize = 16;

/// The numbers of rows of tiles.
#[derive(Clone, Copy, Debug, PartialEq)]
struct TileShape {
    /// The rows of tiles of filters, and of tiles of sums: outputs.
    outputs: usize,
    /// The rows of tiles of planes, and the columns of tiles of filters: pairs of inputs in a row.
    pairs: usize,
}

/// A row of a tile of filters, which fills a cache line.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default)]
struct Line([u32; SIDE]);

/// Eight tiles. Tiles 0 to 3 hold sums, tiles 4 and 5 filters, and tiles 6 and 7 planes.
///
/// An instance belongs to the thread that made it.
trait TileUnit: Sized {
    /// Return tiles of a shape.
    fn configured(shape: TileShape) -> Self;
    /// Load a tile of filters from consecutive lines.
    ///
    /// # Panics
    /// If there are too few lines.
    fn load_filters<const TILE: usize>(&mut self, lines: &[Line]);
    /// Load a tile of planes from rows of [`SIDE`] words, whose starts are `stride` words apart.
    ///
    /// # Panics
    /// If the rows exceed the source.
    fn load_planes<const TILE: usize>(&mut self, source: &[u32], stride: usize);
    /// Set the sums of a tile to 0.
    fn zero<const TILE: usize>(&mut self);
    /// Add the products of filters and planes to sums.
    fn multiply<const SUMS: usize, const FILTERS: usize, const PLANES: usize>(&mut self);
    /// Write the sums of a tile to rows of [`SIDE`] values, whose starts are `stride` values apart.
    ///
    /// # Panics
    /// If the rows exceed `out`.
    fn store<const TILE: usize>(&self, out: &mut [f32], stride: usize);
}

/// Return whether the processor has tiles, the system permits them, and the fastest instruction set is
/// the current one.
pub(crate) fn are_available() -> bool {
    Amx::is_available()
}

/// Filters `(outputs, inputs, 3, 3)` of bfloat16 as tiles.
///
/// The outputs are divided into groups of the rows of a tile, and the pairs of inputs of three rows
/// into chunks of the rows of a tile. The tiles are ordered by chunk, column of the filter, and
/// group. A line holds a word for each pair of inputs. Words of 0 fill the last group and the last chunk.
#[derive(Clone, Debug)]
pub(crate) struct TileFilters {
    lines: Vec<Line>,
    outputs: usize,
    inputs: usize,
    groups: usize,
    chunks: usize,
    shape: TileShape,
}

impl TileFilters {
    /// Return the tiles of filters that are rounded to bfloat16, or None if another convolution must
    /// compute them: for other sizes and strides, and for few planes.
    pub fn new<F: Real>(filters: ArrayView4<'_, F>, stride: usize) -> Option<Self> {
        let (outputs, inputs, rows, columns) = filters.dim();
        let many = inputs >= MIN_INPUTS && outputs >= MIN_OUTPUTS;
        let suits = (rows, columns, stride) == (FILTER_SIZE, FILTER_SIZE, 1) && many;
        suits.then(|| Self::pack(filters))
    }

    fn pack<F: Real>(filters: ArrayView4<'_, F>) -> Self {
        let (outputs, inputs, ..) = filters.dim();
        let pairs = inputs.div_ceil(2);
        // An even number of groups fills the tiles of sums.
        let groups = if outputs <= SIDE {
            1
        } else {
            2 * outputs.div_ceil(2 * SIDE)
        };
        let chunks = (FILTER_SIZE * pairs).div_ceil(SIDE);
        let shape = TileShape {
            outputs: outputs.div_ceil(groups),
            pairs: (FILTER_SIZE * pairs).div_ceil(chunks),
        };
        let mut lines = vec![Line::default(); chunks * FILTER_SIZE * groups * shape.outputs];
        for output in 0..outputs {
            for row in 0..FILTER_SIZE * pairs {
                let (pair, filter_row) = (row % pairs, row / pairs);
                let (chunk, place) = (row / shape.pairs, row % shape.pairs);
                for column in 0..FILTER_SIZE {
                    // The taps are reversed, so that the loops read their input forward.
                    let tap = |input: usize| {
                        let tap = [
                            output,
                            input,
                            FILTER_SIZE - 1 - filter_row,
                            FILTER_SIZE - 1 - column,
                        ];
                        filters.get(tap).map_or(0.0, |tap| tap.as_f64() as f32)
                    };
                    let tile = (chunk * FILTER_SIZE + column) * groups + output / shape.outputs;
                    let line = tile * shape.outputs + output % shape.outputs;
                    lines[line].0[place] = pair_of(tap(2 * pair), tap(2 * pair + 1));
                }
            }
        }
        Self {
            lines,
            outputs,
            inputs,
            groups,
            chunks,
            shape,
        }
    }

    /// Convolve for a region of the filters' output, and write the output of the layer into `out`.
    ///
    /// The rows of the source and of `out` must have the layout
    /// [`RowLayout`](crate::network::tiling::strips::RowLayout). The source must be rounded to
    /// bfloat16.
    pub fn convolve<F: Real, const ROUNDS: bool>(
        &self,
        source: &StripedPlanes<'_, F>,
        output: &Region,
        finish: &Finish<'_, F, ROUNDS>,
        workspace: &mut TileWorkspace<F>,
        out: &mut PlanesMut<'_, F>,
    ) {
        self.convolve_with::<Amx, F, ROUNDS>(source, output, finish, workspace, out);
    }
}

/// Return two numbers that are rounded to bfloat16 as a word. The first one has the lower bits.
#[inline(always)]
fn pair_of(first: f32, second: f32) -> u32 {
    first.to_bits() >> 16 | second.to_bits() & 0xffff_0000
}
