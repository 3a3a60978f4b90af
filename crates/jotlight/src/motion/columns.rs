//! The columns of pixels, and the interpolation of displacements between the centers of tiles.

use super::lines::BLOCK;

/// The number of neighboring pixels that are interpolated together. It divides [`BLOCK`].
const PIXELS_PER_STEP: usize = 8;

/// The columns of pixels.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    number: usize,
    /// Where the columns are between the centers of tiles, if there are tiles.
    places: Vec<Place>,
    /// The same for blocks of columns. It ends before the first block with several centers.
    block_places: Vec<BlockPlace>,
}

impl Columns {
    /// Return `number` columns, given the width of tiles.
    pub fn new(number: usize, tile: Option<usize>) -> Self {
        let tiles = |tile| (tile, number.div_ceil(tile));
        let (places, block_places) = match tile.map(tiles) {
            Some((tile, tiles)) => (
                Place::all(number, tile, tiles),
                BlockPlace::all(number, tile, tiles),
            ),
            None => (Vec::new(), Vec::new()),
        };
        Self {
            number,
            places,
            block_places,
        }
    }

    /// Return the number of columns.
    pub fn number(&self) -> usize {
        self.number
    }

    /// Return the displacements of the pixels of a block, from the values of its row at one time.
    /// After the last column, they are those of this column.
    #[inline(always)]
    pub fn pixels(&self, block: usize, values: &[f32]) -> [f32; BLOCK] {
        let mut pixels = [values[values.len() - 1]; BLOCK];
        if self.places.is_empty() {
            let values = &values[(block * BLOCK).min(values.len())..];
            let length = values.len().min(BLOCK);
            pixels[..length].copy_from_slice(&values[..length]);
            return pixels;
        }
        let (steps, _) = pixels.as_chunks_mut::<PIXELS_PER_STEP>();
        for (index, pixels) in steps.iter_mut().enumerate() {
            let step = block * (BLOCK / PIXELS_PER_STEP) + index;
            *pixels = self.places[step.min(self.places.len() - 1)].interpolate(values);
        }
        pixels
    }

    /// Return where a block is between the centers of tiles, if at most one of them is inside.
    #[inline(always)]
    pub fn block_place(&self, block: usize) -> Option<&BlockPlace> {
        self.block_places.get(block)
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

/// Where a block is between the centers of tiles. At most one center is inside.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockPlace {
    /// The index of the tile on the left, for the first and the last pixel.
    left: [usize; 2],
    /// The distance from its center, in tiles.
    fractions: [f32; 2],
    /// The share of the pixels in each of the two intervals, and their mean distance from the center
    /// on the left, times this share.
    shares: [f32; 2],
    distances: [f32; 2],
    /// The maximum difference from a line through the first and the last pixel, if the slope changes
    /// at a center by 1 per tile.
    height: f32,
}

/// The displacements of a block at one time, which are one or two parts of lines.
#[derive(Clone, Copy)]
pub(super) struct Ends {
    /// The displacements of the first and the last pixel.
    pub first_and_last: [f32; 2],
    pub mean: f32,
    /// The maximum difference from a line through both ends, with a sign.
    pub corner: f32,
    /// A number that is not smaller than any number that was used.
    pub magnitude: f32,
}

impl BlockPlace {
    /// Return the places of all whole blocks before the first block with several centers.
    fn all(columns: usize, tile: usize, tiles: usize) -> Vec<Self> {
        let place_of = |block: usize| {
            let place = |pixel| interval(block * BLOCK + pixel, tile, tiles);
            let ends = [place(0), place(BLOCK - 1)];
            let left = ends.map(|(left, _)| left);
            let (mut shares, mut distances) = ([0.0; 2], [0.0; 2]);
            for pixel in 0..BLOCK {
                let (interval, fraction) = place(pixel);
                let part = usize::from(interval != left[0]);
                shares[part] += 1.0 / BLOCK as f32;
                distances[part] += fraction / BLOCK as f32;
            }
            // The difference is largest if the slope changes in the middle.
            let height = (BLOCK - 1) as f32 / 4.0 / tile as f32;
            (left[1] <= left[0] + 1).then_some(Self {
                left,
                fractions: ends.map(|(_, fraction)| fraction),
                shares,
                distances,
                height,
            })
        };
        (0..columns / BLOCK).map_while(place_of).collect()
    }

    /// Return the displacements of the block, from the values of the centers of tiles.
    #[inline(always)]
    pub fn ends(&self, values: &[f32]) -> Ends {
        let [a, b] = self.left;
        let [value_a, value_b] = [values[a], values[b]];
        let [change_a, change_b] = [values[a + 1] - value_a, values[b + 1] - value_b];
        let first = value_a + self.fractions[0] * change_a;
        let last = value_b + self.fractions[1] * change_b;
        let mean_a = self.shares[0] * value_a + self.distances[0] * change_a;
        let mean_b = self.shares[1] * value_b + self.distances[1] * change_b;
        Ends {
            first_and_last: [first, last],
            mean: mean_a + mean_b,
            corner: self.height * (change_b - change_a),
            magnitude: value_a.abs() + value_b.abs() + change_a.abs() + change_b.abs(),
        }
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
