//! From the sums of the first layer to a picture.

use std::any::Any;
use std::cell::Cell;

use ndarray::{Array2, Array3, ArrayView2, ArrayView3};
use rayon::prelude::*;

use super::block::{check_block, masked_filter};
use super::codes::Tables;
use super::fast;
use super::graph::Graph;
use super::look_up::Table;
use super::lsi::{Padded, Part, Place, in_one_piece, read};
use super::{Layer, Real};
use crate::bits::{PackedBits, check_mask};
use crate::error::{Error, Result};
use crate::sensing::mirrored;

/// Rows and columns of a tile, so that its planes stay near the core. Rows are fewer where there are many threads.
const TILE: (usize, usize) = (64, 1024);
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
pub fn forward<F: Real>(layers: &[Layer<F>], sums: ArrayView3<'_, F>) -> Result<Array2<F>> {
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
    layers: &[Layer<F>],
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
pub fn forward_bits<F: Real>(layers: &[Layer<F>], bits: &PackedBits<'_>) -> Result<Array2<F>> {
    let graph = Graph::new(layers)?;
    let first = &layers[0];
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

fn check<F: Real>(
    layers: &[Layer<F>],
    planes: usize,
    (height, width): (usize, usize),
) -> Result<Graph<'_, F>> {
    let graph = Graph::new(layers)?;
    let expected = layers[0].channels();
    if planes != expected || height * width == 0 {
        let given = (planes, height, width);
        return Err(Error::shape("planes of the first layer", expected, given));
    }
    Ok(graph)
}

/// The picture in tiles, each through all layers while it is near the core. `first` fills a part of the planes `(C, rows, columns)` that the
/// first layer gives.
fn picture<F: Real>(
    graph: &Graph<'_, F>,
    size: (usize, usize),
    first: impl Fn(&Place, &mut [F]) + Sync,
) -> Array2<F> {
    let (height, width) = size;
    let mut picture = Array2::zeros((height, width));
    // Bands of tiles, as many for each thread.
    let (tile, least) = tile_of(graph);
    let bands = height.div_ceil(tile.0);
    let bands = bands.next_multiple_of(rayon::current_num_threads());
    let rows = height.div_ceil(bands).max(least);
    let rows = rows.next_multiple_of(fast::ROWS * graph.step);
    let pixels = picture.as_slice_mut().unwrap_or_default();
    pixels
        .par_chunks_mut(rows * width)
        .enumerate()
        .for_each_init(Kept::default, |Kept(scratch), (band, out)| {
            let start = band * rows;
            for column in (0..width).step_by(tile.1) {
                let wanted = Place {
                    rows: start..start + out.len() / width,
                    columns: column..(column + tile.1).min(width),
                };
                let (place, tile) = scratch.tile(graph, size, &wanted, &first);
                let tile = tile.chunks_exact(place.columns.len());
                for (out, tile) in out.chunks_exact_mut(width).zip(tile) {
                    out[wanted.columns.clone()].copy_from_slice(&tile[..wanted.columns.len()]);
                }
            }
        });
    picture
}

/// Rows and columns of a tile, which are many beside what it reads around it, and the rows that it has at least.
fn tile_of<F: Real>(graph: &Graph<'_, F>) -> ((usize, usize), usize) {
    let everything = Place {
        rows: graph.step << 16..(graph.step << 16) + graph.step,
        columns: 0..1,
    };
    let size = (graph.step << 17, graph.step << 17);
    let around = wanted_of(graph, size, &everything)[0].rows.len();
    let rows = TILE.0.max(4 * around).next_multiple_of(graph.step);
    ((rows, TILE.1), around.min(rows))
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
        let group = layer.fast().map_or(1, |_| fast::ROWS);
        let place = place.with_rows(group * up, graph.size(index, size).0);
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

/// What a thread works on.
#[derive(Default)]
struct Scratch<F> {
    /// The planes of every layer, as long as they are used.
    planes: Vec<Vec<F>>,
    /// Room for the next ones.
    free: Vec<Vec<F>>,
    padded: Padded<F>,
    /// What quick filters work on.
    between: Vec<F>,
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

    /// A part of the picture, and which: what is wanted or a little more.
    fn tile(
        &mut self,
        graph: &Graph<'_, F>,
        picture: (usize, usize),
        last: &Place,
        first: impl Fn(&Place, &mut [F]),
    ) -> (Place, &[F]) {
        // Planes with a stride need rows and columns in multiples.
        let size = (
            picture.0.next_multiple_of(graph.step),
            picture.1.next_multiple_of(graph.step),
        );
        let wanted = wanted_of(graph, size, last);
        let used = self.planes.drain(..);
        self.free.extend(used.filter(|room| room.capacity() > 0));
        for (index, layer) in graph.layers.iter().enumerate() {
            let place = &wanted[index];
            let mut out = self.room(layer.channels() * place.pixels());
            if index == 0 {
                continued(
                    place,
                    picture,
                    layer.channels(),
                    &mut out,
                    &mut self.padded,
                    &first,
                );
                self.planes.push(out);
                continue;
            }
            let (source, up) = (graph.sources[index], layer.wiring.upsampling);
            let mut deep = match up {
                1 => Vec::new(),
                _ => self.room(out.len()),
            };
            let part = Part {
                planes: &self.planes[source],
                place: wanted[source].clone(),
                size: graph.size(source, size),
            };
            let before = place.divided(up);
            let sums = if up == 1 { &mut out } else { &mut deep };
            if let Some(fast) = layer.fast() {
                fast.correlate(&part, &before, &mut self.between, sums);
            } else {
                self.padded.fill(&part, &before, layer.taps());
                self.padded.convolve(layer.taps(), sums);
            }
            if up != 1 {
                let size = (before.rows.len(), before.columns.len());
                to_space(&deep, up, size, &mut out);
                self.free.push(deep);
            }
            if let Some(kept) = layer.wiring.adds {
                add(&self.planes[kept], &wanted[kept], place, &mut out);
            }
            layer.bend(&mut out);
            self.planes.push(out);
            for used in 0..index {
                if graph.last_use[used] == index {
                    self.free.push(std::mem::take(&mut self.planes[used]));
                }
            }
        }
        match (wanted.last(), self.planes.last()) {
            (Some(place), Some(planes)) => (place.clone(), planes),
            _ => (Place::default(), &[]),
        }
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
fn add<F: Real>(kept: &[F], from: &Place, place: &Place, out: &mut [F]) {
    let (width, left) = (from.columns.len(), place.columns.start - from.columns.start);
    let planes = kept.chunks_exact(from.pixels());
    for (kept, out) in planes.zip(out.chunks_exact_mut(place.pixels())) {
        let rows = kept
            .chunks_exact(width)
            .skip(place.rows.start - from.rows.start);
        for (kept, out) in rows.zip(out.chunks_exact_mut(place.columns.len())) {
            for (out, &kept) in out.iter_mut().zip(&kept[left..]) {
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
        let graph = Graph::new(&layers)?;
        let place = Place {
            rows: 0..8,
            columns: 0..8,
        };
        let mut scratch = Scratch::default();
        let mut rooms = || {
            scratch.tile(&graph, (8, 8), &place, |_, out| out.fill(1.0));
            scratch.free.len() + scratch.planes.len()
        };
        let first = rooms();
        for _ in 0..20 {
            assert!(rooms() <= first + 1);
        }
        Ok(())
    }
}
