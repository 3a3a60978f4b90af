//! A picture in tiles, one below the other, each through all layers while it is near the core. Of every layer they keep the rows that the
//! next tile still needs, so that none is found twice.

use std::any::Any;
use std::cell::Cell;
use std::ops::Range;

use ndarray::Array2;
use rayon::prelude::*;

use super::fast;
use super::graph::Graph;
use super::lsi::{Padded, read};
use super::place::{Part, Place, Strip};
use super::{Layer, Real};
use crate::error::Result;
use crate::sensing::mirror_index as mirrored;

/// Pixels of a tile, or of each strip of it, so that its planes stay near the core.
const PIXELS: usize = 1 << 16;
/// Numbers of planes of a tile.
const NUMBERS: usize = 1 << 22;
/// Columns of a tile, at most and at least, which are many beside those that it reads around it.
const COLUMNS: usize = 1024;
const LEAST: usize = 64;
/// How many times as many rows a band has as are read for a single one, for what bands find twice.
const AROUND: usize = 4;
/// Bands for each thread, and strips for each where threads share a tile, so that none waits long for another.
const BANDS: usize = 4;
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
    let group = fast::ROWS * graph.step;
    let rows = height.div_ceil(bands).next_multiple_of(group);
    let pixels = PIXELS.min(NUMBERS / graph.numbers);
    let wide = (pixels / group).clamp(LEAST, COLUMNS);
    let out = picture.as_slice_mut().unwrap_or_default();
    out.par_chunks_mut(rows * width).enumerate().for_each_init(
        Kept::default,
        |Kept(scratch), (band, out)| {
            let rows = band * rows..(band * rows + rows).min(height);
            for left in (0..width).step_by(wide) {
                let columns = left..(left + wide).min(width);
                let tile = strips * pixels / columns.len().max(LEAST);
                let tile = tile.max(1).next_multiple_of(group);
                let tiles = rows.clone().step_by(tile).map(|top| Place {
                    rows: top..(top + tile).min(rows.end),
                    columns: columns.clone(),
                });
                scratch.column(graph, size, tiles, strips, &first, |place, tile| {
                    let out = &mut out[(place.rows.start - rows.start) * width..];
                    for (row, out) in place.rows.clone().zip(out.chunks_exact_mut(width)) {
                        let row = &tile.row(row).of(0)[left - tile.columns.start..];
                        out[columns.clone()].copy_from_slice(&row[..columns.len()]);
                    }
                });
            }
        },
    );
    picture
}

/// Bands, one thread for each, and where there are too few of them strips of each tile, for the threads to share.
fn shares<F: Real>(graph: &Graph<'_, F>, height: usize) -> (usize, usize) {
    let threads = rayon::current_num_threads();
    if threads == 1 {
        return (1, 1);
    }
    let start = graph.step << 16;
    let one = Place {
        rows: start..start + graph.step,
        columns: 0..1,
    };
    let needed = &wanted_of(graph, (2 * start, 2 * start), &one)[0].rows;
    match height / (AROUND * needed.len()) {
        few if few < threads => {
            let bands = few.max(1);
            (bands, (STRIPS * threads).div_ceil(bands))
        }
        many => (threads * (many / threads).min(BANDS), 1),
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
    // What goes on past the last row is made of rows above it.
    let start = start.min(height.saturating_sub(end.saturating_sub(height)));
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

/// The planes of a layer, in strips one below the other.
struct Planes<F> {
    strips: Vec<Strip<Vec<F>>>,
    columns: Range<usize>,
}

impl<F: Real> Planes<F> {
    /// To be read, as part of planes of a size.
    fn part(&self, size: (usize, usize)) -> Part<'_, F> {
        let strips = self.strips.iter().map(|strip| Strip {
            rows: strip.rows.clone(),
            data: &strip.data[..],
        });
        Part {
            strips: strips.collect(),
            columns: self.columns.clone(),
            size,
        }
    }
}

/// What a thread works on.
#[derive(Default)]
struct Scratch<F> {
    /// The planes of every layer, as long as they are used.
    planes: Vec<Planes<F>>,
    /// Room for the next ones, and how much of it, from the first on, was free before this tile.
    free: Vec<Vec<F>>,
    idle: usize,
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
    /// Room for so many numbers, of what is free or new.
    fn room(&mut self, length: usize) -> Vec<F> {
        let enough = length..=2 * length;
        let best = (0..self.free.len())
            .filter(|&index| enough.contains(&self.free[index].capacity()))
            .min_by_key(|&index| self.free[index].capacity());
        let Some(best) = best else {
            return vec![F::zero(); length];
        };
        self.idle -= usize::from(best < self.idle);
        let mut room = self.free.remove(best);
        room.resize(length, F::zero());
        room
    }

    /// Gives back what no tile has needed since the last call.
    fn give_back(&mut self) {
        self.free.drain(..self.idle);
        self.idle = self.free.len();
    }

    /// Strips for rows of a layer's planes, each of `group` rows or a multiple of it.
    fn strips(
        &mut self,
        channels: usize,
        place: &Place,
        strips: usize,
        group: usize,
    ) -> Vec<Strip<Vec<F>>> {
        let Range { start, end } = place.rows;
        let height = (end - start).div_ceil(strips).next_multiple_of(group);
        let rows = (start..end)
            .step_by(height)
            .map(|top| top..(top + height).min(end));
        let strip = |rows: Range<usize>| Strip {
            data: self.room(channels * rows.len() * place.columns.len()),
            rows,
        };
        rows.map(strip).collect()
    }

    /// The rows of a layer above one are not needed any more.
    fn forget(&mut self, layer: usize, row: usize) {
        let strips = &mut self.planes[layer].strips;
        let above = strips.partition_point(|strip| strip.rows.end <= row);
        self.free
            .extend(strips.drain(..above).map(|strip| strip.data));
    }

    /// Parts of the picture one below the other: `done` is told each as it is found.
    fn column(
        &mut self,
        graph: &Graph<'_, F>,
        picture: (usize, usize),
        tiles: impl Iterator<Item = Place>,
        strips: usize,
        first: impl Fn(&Place, &mut [F]) + Sync,
        mut done: impl FnMut(&Place, &Part<'_, F>),
    ) {
        // Planes with a stride need rows and columns in multiples.
        let size = (
            picture.0.next_multiple_of(graph.step),
            picture.1.next_multiple_of(graph.step),
        );
        self.rooms
            .resize_with(self.rooms.len().max(strips), Room::default);
        self.planes.clear();
        let wanted = |tile: Place| (wanted_of(graph, size, &tile), tile);
        let mut tiles = tiles.map(wanted).peekable();
        while let Some((wanted, tile)) = tiles.next() {
            let planes = |place: &Place| Planes {
                strips: Vec::new(),
                columns: place.columns.clone(),
            };
            if self.planes.is_empty() {
                self.planes.extend(wanted.iter().map(planes));
            }
            // Where the rows begin that the next tile needs of a layer.
            let next = tiles.peek().map(|(wanted, _)| wanted);
            let next = |layer: usize| next.map_or(usize::MAX, |wanted| wanted[layer].rows.start);
            for (index, wanted) in wanted.iter().enumerate() {
                self.extend(graph, index, wanted, (picture, size), strips, &first);
                for used in (0..index).filter(|&used| graph.last_use[used] == index) {
                    self.forget(used, next(used));
                }
            }
            let last = graph.layers.len() - 1;
            done(&tile, &self.planes[last].part(size));
            self.forget(last, next(last));
            self.give_back();
        }
    }

    /// Those rows of a layer that are wanted and not known yet. `first` fills a part of the first one.
    fn extend(
        &mut self,
        graph: &Graph<'_, F>,
        index: usize,
        wanted: &Place,
        (picture, size): ((usize, usize), (usize, usize)),
        strips: usize,
        first: &(impl Fn(&Place, &mut [F]) + Sync),
    ) {
        let layer = graph.layers[index];
        let known = self.planes[index].strips.last();
        let known = known.map_or(0, |strip| strip.rows.end);
        let new = Place {
            rows: known.max(wanted.rows.start)..wanted.rows.end,
            columns: wanted.columns.clone(),
        };
        if new.rows.is_empty() {
            return;
        }
        let mut new = self.strips(layer.channels(), &new, strips, group_of(layer));
        let part = |layer: usize| self.planes[layer].part(graph.size(layer, size));
        let source = part(graph.sources[index]);
        let kept = layer.wiring.adds.map(part);
        let rooms = self.rooms.par_iter_mut();
        new.par_iter_mut().zip(rooms).for_each(|(strip, room)| {
            let place = Place {
                rows: strip.rows.clone(),
                columns: wanted.columns.clone(),
            };
            let out = &mut strip.data;
            if index == 0 {
                continued(
                    &place,
                    picture,
                    layer.channels(),
                    out,
                    &mut room.padded,
                    first,
                );
            } else {
                room.give(layer, &source, kept.as_ref(), &place, out);
            }
        });
        self.planes[index].strips.extend(new);
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
    let left = place.columns.start - kept.columns.start;
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
            let tiles = [place.clone()].into_iter();
            let ones = |_: &Place, out: &mut [f32]| out.fill(1.0);
            scratch.column(&graph, (8, 8), tiles, 2, ones, |_, _| ());
            scratch.free.len()
        };
        let first = rooms();
        for _ in 0..20 {
            assert!(rooms() <= first + 1);
        }
        Ok(())
    }
}
