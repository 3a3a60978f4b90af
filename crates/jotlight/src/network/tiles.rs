//! A picture in tiles, each through all layers while it is near the core.

use std::any::Any;
use std::cell::Cell;
use std::ops::Range;

use ndarray::Array2;
use rayon::prelude::*;

use super::fast;
use super::graph::Graph;
use super::lsi::{Padded, read};
use super::place::{Part, Place};
use super::{Layer, Real};
use crate::error::Result;
use crate::sensing::mirrored;

/// Rows and columns of a tile, so that its planes stay near the core.
const TILE: (usize, usize) = (64, 1024);
/// How many times as many rows as are read for a single one, so that little is found twice.
const AROUND: usize = 4;
/// Strips for each thread where these share a tile, so that none waits long for another.
const STRIPS: usize = 2;

/// The picture that the layers give. `first` fills a part of the planes `(C, rows, columns)` of the first one.
pub(super) fn picture<F: Real>(
    graph: &Graph<'_, F>,
    size: (usize, usize),
    first: impl Fn(&Place, &mut [F]) + Sync,
) -> Array2<F> {
    let (height, width) = size;
    let mut picture = Array2::zeros((height, width));
    let (bands, strips) = shares(graph, height);
    let rows = height
        .div_ceil(bands)
        .next_multiple_of(fast::ROWS * graph.step);
    let pixels = picture.as_slice_mut().unwrap_or_default();
    pixels
        .par_chunks_mut(rows * width)
        .enumerate()
        .for_each_init(Kept::default, |Kept(scratch), (band, out)| {
            let start = band * rows;
            for column in (0..width).step_by(TILE.1) {
                let wanted = Place {
                    rows: start..start + out.len() / width,
                    columns: column..(column + TILE.1).min(width),
                };
                let tile = scratch.tile(graph, size, &wanted, strips, &first);
                for (row, out) in wanted.rows.clone().zip(out.chunks_exact_mut(width)) {
                    let row = &tile.row(row).of(0)[..wanted.columns.len()];
                    out[wanted.columns.clone()].copy_from_slice(row);
                }
            }
        });
    picture
}

/// Bands of tiles, one thread for each, and where there are too few of them strips of each tile, for the threads to share.
fn shares<F: Real>(graph: &Graph<'_, F>, height: usize) -> (usize, usize) {
    let threads = rayon::current_num_threads();
    let start = graph.step << 16;
    let one = Place {
        rows: start..start + graph.step,
        columns: 0..1,
    };
    let around = wanted_of(graph, (2 * start, 2 * start), &one)[0].rows.len();
    match height / TILE.0.max(AROUND * around) {
        few if few < threads => {
            let bands = few.max(1);
            let strips = if threads == 1 { 1 } else { STRIPS * threads };
            (bands, strips.div_ceil(bands))
        }
        many => (many / threads * threads, 1),
    }
}

/// The rows of the data that some rows of a picture are made of: alone they give the same as among all others.
///
/// # Errors
/// [`crate::Error`] when the layers do not fit each other.
pub fn rows_needed<F: Real>(
    layers: &[&Layer<F>],
    height: usize,
    rows: Range<usize>,
) -> Result<Range<usize>> {
    let graph = Graph::new(layers)?;
    // So that rows are grouped as in the whole.
    let group = fast::ROWS * graph.step;
    let wanted = Place {
        rows: rows.start / group * group..rows.end.min(height).next_multiple_of(graph.step),
        columns: 0..graph.step,
    };
    let size = (height.next_multiple_of(graph.step), graph.step);
    let Range { start, end } = wanted_of(&graph, size, &wanted)[0].rows;
    Ok(start / group * group..end.next_multiple_of(group).min(height))
}

/// The part of its planes that each layer has to give, found from the last one on.
fn wanted_of<F: Real>(graph: &Graph<'_, F>, size: (usize, usize), last: &Place) -> Vec<Place> {
    let mut wanted = vec![Place::default(); graph.layers.len()];
    if let Some(place) = wanted.last_mut() {
        *place = last.clone();
    }
    for (index, layer) in graph.layers.iter().enumerate().rev() {
        if index == 0 {
            break;
        }
        let up = layer.wiring.upsampling;
        let place = wanted[index].aligned(up);
        let place = place.with_rows(group_of(layer), graph.size(index, size).0);
        wanted[index] = place.clone();
        if let Some(kept) = layer.wiring.adds {
            wanted[kept].include(&place);
        }
        let source = graph.sources[index];
        let before = place.divided(up);
        let (_, _, lines, columns) = layer.filters.dim();
        let planes = graph.size(source, size);
        let read = read((lines, columns), layer.wiring.stride, &before, planes);
        wanted[source].include(&read);
    }
    wanted
}

/// The planes of a layer, in strips of rows.
#[derive(Default)]
struct Planes<F> {
    strips: Vec<Vec<F>>,
    /// Rows of every strip but the last.
    height: usize,
    place: Place,
}

impl<F: Real> Planes<F> {
    /// To be read, as part of planes of a size.
    fn part(&self, size: (usize, usize)) -> Part<'_, F> {
        Part {
            strips: self.strips.iter().map(Vec::as_slice).collect(),
            height: self.height,
            place: self.place.clone(),
            size,
        }
    }
}

/// What a thread works on.
#[derive(Default)]
struct Scratch<F> {
    /// The planes of every layer, as long as they are used.
    planes: Vec<Planes<F>>,
    /// Room for the next ones.
    free: Vec<Vec<F>>,
    /// What each strip is worked on in.
    rooms: Vec<Room<F>>,
}

/// What a strip is worked on in.
#[derive(Default)]
struct Room<F> {
    padded: Padded<F>,
    /// What quick filters work on.
    between: Vec<F>,
    /// What is to go from depth to space.
    deep: Vec<F>,
}

thread_local! {
    /// What this thread worked on last: new memory takes longer than a small picture.
    static KEPT: Cell<Option<Box<dyn Any>>> = const { Cell::new(None) };
}

/// What a thread works on, kept for its next picture.
struct Kept<F: Real>(Scratch<F>);

impl<F: Real> Default for Kept<F> {
    fn default() -> Self {
        let kept = KEPT.take().and_then(|kept| kept.downcast().ok());
        Self(kept.map_or_else(Scratch::default, |kept| *kept))
    }
}

impl<F: Real> Drop for Kept<F> {
    fn drop(&mut self) {
        KEPT.set(Some(Box::new(std::mem::take(&mut self.0))));
    }
}

impl<F: Real> Scratch<F> {
    /// Room for so many numbers: the least that is enough, or else the most, so that little is asked for anew.
    fn room(&mut self, length: usize) -> Vec<F> {
        let order = |room: &Vec<F>| match room.capacity() {
            enough if enough >= length => (false, enough),
            little => (true, usize::MAX - little),
        };
        let best = (0..self.free.len()).min_by_key(|&index| order(&self.free[index]));
        let mut room = best.map_or_else(Vec::new, |index| self.free.swap_remove(index));
        if room.capacity() < length {
            // Nothing has to be copied.
            room.clear();
        }
        room.resize(length, F::zero());
        room
    }

    /// Room for the planes of a layer, in strips that hold `group` rows or a multiple of it.
    fn rooms(&mut self, channels: usize, place: &Place, strips: usize, group: usize) -> Planes<F> {
        let rows = place.rows.len();
        let height = rows.div_ceil(strips).next_multiple_of(group);
        let heights = (0..rows)
            .step_by(height)
            .map(|start| height.min(rows - start));
        let length = |rows: usize| channels * rows * place.columns.len();
        Planes {
            strips: heights.map(|rows| self.room(length(rows))).collect(),
            height,
            place: place.clone(),
        }
    }

    /// A part of the picture: what is wanted or a little more.
    fn tile(
        &mut self,
        graph: &Graph<'_, F>,
        picture: (usize, usize),
        last: &Place,
        strips: usize,
        first: impl Fn(&Place, &mut [F]) + Sync,
    ) -> Part<'_, F> {
        // Planes with a stride need rows and columns in multiples.
        let size = (
            picture.0.next_multiple_of(graph.step),
            picture.1.next_multiple_of(graph.step),
        );
        let wanted = wanted_of(graph, size, last);
        let used = self.planes.drain(..).flat_map(|planes| planes.strips);
        self.free.extend(used);
        self.rooms
            .resize_with(self.rooms.len().max(strips), Room::default);
        for (index, layer) in graph.layers.iter().enumerate() {
            let (channels, place) = (layer.channels(), &wanted[index]);
            let mut out = self.rooms(channels, place, strips, group_of(layer));
            let source = &self.planes.get(graph.sources[index]);
            let source = source.map(|planes| planes.part(graph.size(graph.sources[index], size)));
            let kept = layer
                .wiring
                .adds
                .map(|kept| self.planes[kept].part(graph.size(kept, size)));
            let height = out.height;
            let rooms = self.rooms.par_iter_mut();
            let strips = out.strips.par_iter_mut().zip(rooms).enumerate();
            strips.for_each(|(number, (out, room))| {
                let start = place.rows.start + number * height;
                let place = Place {
                    rows: start..(start + height).min(place.rows.end),
                    columns: place.columns.clone(),
                };
                match &source {
                    None => continued(&place, picture, channels, out, &mut room.padded, &first),
                    Some(source) => room.give(layer, source, kept.as_ref(), &place, out),
                }
            });
            self.planes.push(out);
            for used in 0..index {
                if graph.last_use[used] == index {
                    let used = std::mem::take(&mut self.planes[used]);
                    self.free.extend(used.strips);
                }
            }
        }
        let planes = self.planes.last().map(|planes| planes.part(size));
        planes.unwrap_or_else(|| Part::whole(&[], Place::default(), size))
    }
}

/// Rows of a layer's planes that are found together.
fn group_of<F: Real>(layer: &Layer<F>) -> usize {
    let rows = layer.fast().map_or(1, |_| fast::ROWS);
    rows * layer.wiring.upsampling
}

impl<F: Real> Room<F> {
    /// A strip of the planes of a layer, from those that it reads and those that it adds.
    fn give(
        &mut self,
        layer: &Layer<F>,
        source: &Part<'_, F>,
        kept: Option<&Part<'_, F>>,
        place: &Place,
        out: &mut [F],
    ) {
        let up = layer.wiring.upsampling;
        let before = place.divided(up);
        let Self {
            padded,
            between,
            deep,
        } = self;
        let mut filter = |sums: &mut [F]| {
            if let Some(fast) = layer.fast() {
                fast.correlate(source, &before, between, sums);
            } else {
                padded.fill(source, &before, layer.taps());
                padded.convolve(layer.taps(), sums);
            }
        };
        if up == 1 {
            filter(out);
        } else {
            deep.resize(deep.len().max(out.len()), F::zero());
            let deep = &mut deep[..out.len()];
            filter(deep);
            to_space(deep, up, (before.rows.len(), before.columns.len()), out);
        }
        if let Some(kept) = kept {
            add(kept, place, out);
        }
        layer.bend(out);
    }
}

/// The first layer's planes, past the picture's last row and column mirrored.
fn continued<F: Real>(
    place: &Place,
    picture: (usize, usize),
    channels: usize,
    out: &mut [F],
    spare: &mut Padded<F>,
    first: impl Fn(&Place, &mut [F]),
) {
    if place.rows.end <= picture.0 && place.columns.end <= picture.1 {
        return first(place, out);
    }
    let there = |place: &std::ops::Range<usize>, size: usize| {
        let beyond = place.end.saturating_sub(size);
        place.start.min(size.saturating_sub(beyond.max(1)))..place.end.min(size)
    };
    let known = Place {
        rows: there(&place.rows, picture.0),
        columns: there(&place.columns, picture.1),
    };
    let planes = spare.room(channels * known.pixels());
    first(&known, planes);
    let width = known.columns.len();
    let sources = planes.chunks_exact(known.pixels());
    for (source, out) in sources.zip(out.chunks_exact_mut(place.pixels())) {
        let rows = out.chunks_exact_mut(place.columns.len());
        for (row, out) in place.rows.clone().zip(rows) {
            let row = mirrored(row as isize, picture.0) - known.rows.start;
            for (column, out) in place.columns.clone().zip(out) {
                let column = mirrored(column as isize, picture.1) - known.columns.start;
                *out = source[row * width + column];
            }
        }
    }
}

/// From depth to space: of every `up`² planes of `height` rows and `width` columns one that is `up` times as high and wide.
fn to_space<F: Real>(deep: &[F], up: usize, (height, width): (usize, usize), out: &mut [F]) {
    let planes = deep.chunks_exact(up * up * height * width);
    for (deep, out) in planes.zip(out.chunks_exact_mut(up * up * height * width)) {
        for (phase, deep) in deep.chunks_exact(height * width).enumerate() {
            let rows = out
                .chunks_exact_mut(up * width)
                .skip(phase / up)
                .step_by(up);
            for (deep, out) in deep.chunks_exact(width).zip(rows) {
                let places = out.iter_mut().skip(phase % up).step_by(up);
                for (out, &value) in places.zip(deep) {
                    *out = value;
                }
            }
        }
    }
}

/// Adds a part of kept planes.
fn add<F: Real>(kept: &Part<'_, F>, place: &Place, out: &mut [F]) {
    let left = place.columns.start - kept.place.columns.start;
    let width = place.columns.len();
    for (plane, out) in out.chunks_exact_mut(place.pixels()).enumerate() {
        for (row, out) in place.rows.clone().zip(out.chunks_exact_mut(width)) {
            let kept = &kept.row(row).of(plane)[left..][..width];
            for (out, &kept) in out.iter_mut().zip(kept) {
                *out += kept;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array4;

    use super::*;
    use crate::network::Wiring;

    #[test]
    fn a_threads_room_does_not_grow_from_tile_to_tile() -> Result<()> {
        let layer = || {
            let one = Array4::from_elem((1, 1, 3, 3), 1f32);
            Layer::new(one, None, 0.0, 1.0, Wiring::default())
        };
        let layers = [layer()?, layer()?, layer()?, layer()?];
        let graph = Graph::new(&layers.each_ref())?;
        let place = Place {
            rows: 0..8,
            columns: 0..8,
        };
        let mut scratch = Scratch::default();
        let mut rooms = || {
            scratch.tile(&graph, (8, 8), &place, 2, |_, out| out.fill(1.0));
            scratch.free.len() + scratch.planes.len()
        };
        let first = rooms();
        for _ in 0..20 {
            assert!(rooms() <= first + 1);
        }
        Ok(())
    }
}
