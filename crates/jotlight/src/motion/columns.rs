//! The columns of pixels, and the interpolation of displacements between the centers of tiles.

use super::lines::BLOCK;
use super::rounding::{fold, fold_halves};

/// The number of neighboring pixels that are interpolated together. It divides [`BLOCK`].
const PIXELS_PER_STEP: usize = 8;

/// The columns of pixels.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    number: usize,
    /// Where the columns are between the centers of tiles, if there are tiles.
    places: Vec<Place>,
    /// Whether each block is a tile.
    blocks_are_tiles: bool,
}

impl Columns {
    /// Return `number` columns, given the width of tiles.
    pub fn new(number: usize, tile: Option<usize>) -> Self {
        let places = tile.map(|tile| Place::all(number, tile, number.div_ceil(tile)));
        Self {
            number,
            places: places.unwrap_or_default(),
            blocks_are_tiles: tile == Some(BLOCK),
        }
    }

    /// Return the number of columns.
    pub fn number(&self) -> usize {
        self.number
    }

    /// Return the number of columns of a block.
    #[inline(always)]
    pub fn length(&self, block: usize) -> usize {
        self.number.saturating_sub(block * BLOCK).min(BLOCK)
    }

    /// Return whether each block is a tile.
    #[inline(always)]
    pub fn blocks_are_tiles(&self) -> bool {
        self.blocks_are_tiles
    }

    /// Return the displacements of the pixels of a block, from the values of its row at one time.
    /// After the last column, they are those of this column.
    #[inline(always)]
    pub fn pixels(&self, block: usize, values: &[f32]) -> [f32; BLOCK] {
        // The value before the first one is only needed around the centers of tiles.
        let values = &values[1..];
        let mut pixels = [0.0; BLOCK];
        if self.places.is_empty() {
            pixels.copy_from_slice(&values[block * BLOCK..][..BLOCK]);
            return pixels;
        }
        let (steps, _) = pixels.as_chunks_mut::<PIXELS_PER_STEP>();
        for (index, pixels) in steps.iter_mut().enumerate() {
            let step = block * (BLOCK / PIXELS_PER_STEP) + index;
            *pixels = self.places[step.min(self.places.len() - 1)].interpolate(values);
        }
        pixels
    }

    /// Replace `means` with the mean displacement of each block, from the values of its row.
    #[inline(always)]
    pub fn average(&self, values: &[f32], means: &mut [f32]) {
        let add = |a: f32, b: f32| a + b;
        let whole = if self.blocks_are_tiles {
            self.number / BLOCK
        } else {
            0
        };
        let neighbors = values.iter().zip(&values[1..]).zip(&values[2..]);
        for (mean, ((left, value), right)) in means[..whole].iter_mut().zip(neighbors) {
            // The pixels on either side of the center are a quarter of a tile away from it.
            *mean = value + 0.125 * (left - value + (right - value));
        }
        for block in whole..means.len() {
            let (length, pixels) = (self.length(block), self.pixels(block, values));
            let sum = if length == BLOCK {
                fold(&fold_halves(&pixels, &add), add)
            } else {
                pixels[..length].iter().sum()
            };
            means[block] = sum / length as f32;
        }
    }
}

/// Where neighboring columns are between the centers of tiles.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// The index of the tile on the left.
    left: [usize; PIXELS_PER_STEP],
    /// The distance from its center, in tiles.
    fractions: [f32; PIXELS_PER_STEP],
}

impl Place {
    /// Return the places of all columns. The last one fills the rest of the last step.
    fn all(columns: usize, tile: usize, tiles: usize) -> Vec<Self> {
        let place = |step: usize| {
            let mut place = Self {
                left: [0; PIXELS_PER_STEP],
                fractions: [0.0; PIXELS_PER_STEP],
            };
            for pixel in 0..PIXELS_PER_STEP {
                let column = (step * PIXELS_PER_STEP + pixel).min(columns - 1);
                (place.left[pixel], place.fractions[pixel]) = interval(column, tile, tiles);
            }
            place
        };
        let steps = columns.div_ceil(PIXELS_PER_STEP);
        (0..steps).map(place).collect()
    }

    /// Interpolate the values of the centers of tiles, the last of which is repeated.
    #[inline(always)]
    fn interpolate(&self, values: &[f32]) -> [f32; PIXELS_PER_STEP] {
        let (left, fractions) = (&self.left, &self.fractions);
        let mut pixels = [0.0; PIXELS_PER_STEP];
        if left[0] == left[PIXELS_PER_STEP - 1] {
            // The compiler vectorizes this loop.
            let (value, difference) = (values[left[0]], values[left[0] + 1] - values[left[0]]);
            for i in 0..PIXELS_PER_STEP {
                pixels[i] = value + fractions[i] * difference;
            }
        } else {
            for i in 0..PIXELS_PER_STEP {
                let (value, next) = (values[left[i]], values[left[i] + 1]);
                pixels[i] = value + fractions[i] * (next - value);
            }
        }
        pixels
    }
}

/// Return the interval of a pixel between the centers of `tiles` tiles, and its place in it.
///
/// The place is from 0 to 1, or beyond for the pixels before the first and after the last center.
pub(super) fn interval(pixel: usize, tile: usize, tiles: usize) -> (usize, f32) {
    let index = (pixel.saturating_sub(tile / 2) / tile).min(tiles.saturating_sub(2));
    let center = (tile * index) as f32 + (tile - 1) as f32 / 2.0;
    (index, (pixel as f32 - center) / tile as f32)
}
