//! Filters over a pixel's block of bits, by tables: the bits of a block are a number, and tables tell what the taps make of it.

use ndarray::{Array3, ArrayView3, ArrayView4};
use rayon::prelude::*;

use super::place::Place;
use super::{Real, Spline};
use crate::bits::{PackedBits, bit_field as field};
use crate::cpu::levels;

/// Bits of a table: of one for the whole block, if there are twice as many pixels as entries, and else of each of several.
const WHOLE: usize = 16;
const PART: usize = 10;

/// Entries that make it worth while to start a task.
const TASK: usize = 1 << 13;

/// Some jots of a line, in one frame.
struct Field {
    frame: usize,
    line: usize,
    first: usize,
    length: usize,
}

/// The tables of a layer's filters `(C, T, K̂, K̂)`.
pub(super) struct Tables<F> {
    side: usize,
    groups: Vec<Group<F>>,
}

struct Group<F> {
    fields: Vec<Field>,
    /// Of each channel.
    tables: Vec<Vec<F>>,
}

impl<F: Real> Group<F> {
    /// One for the bits of both, with the sums that both would have, to the last place: pictures and their parts have the same.
    fn with(mut self, other: Self) -> Self {
        for (table, other) in self.tables.iter_mut().zip(&other.tables) {
            let sums = |&first: &F| other.iter().map(move |&second| first + second);
            *table = table.iter().flat_map(sums).collect();
        }
        self.fields.extend(other.fields);
        self
    }
}

impl<F: Real> Tables<F> {
    /// For so many pixels.
    pub fn new(filters: ArrayView4<'_, F>, pixels: usize) -> Self {
        let (_, frames, side, _) = filters.dim();
        let whole = frames * side * side;
        let worth = whole <= WHOLE && pixels >= 2 << whole;
        let groups = groups(frames, side).into_iter().map(|fields| {
            let tables = filters.outer_iter().map(|taps| table(&fields, taps));
            let tables = tables.collect();
            Group { fields, tables }
        });
        let mut groups: Vec<_> = groups.collect();
        if worth {
            groups = groups.into_iter().reduce(Group::with).into_iter().collect();
        }
        Self { side, groups }
    }

    /// Puts φ(p) in the place of p, where one table holds it whole; tells whether it did.
    pub fn bend(&mut self, splines: &[Spline<F>]) -> bool {
        let [group] = &mut self.groups[..] else {
            return false;
        };
        for (spline, table) in splines.iter().zip(&mut group.tables) {
            table
                .par_chunks_mut(TASK)
                .for_each(|part| spline.apply(part));
        }
        true
    }

    /// p of some pixels, `(C, rows, columns)`: equation (11).
    pub fn fill(&self, bits: &PackedBits<'_>, place: &Place, out: &mut [F]) {
        // Eight pixels begin with a byte, however many jots each has.
        let first = place.columns.start / 8 * 8;
        let mut codes = vec![0u32; place.columns.end - first];
        let (skipped, width) = (place.columns.start - first, place.columns.len());
        out.fill(F::zero());
        for (line, row) in place.rows.clone().enumerate() {
            for group in &self.groups {
                codes.fill(0);
                for field in &group.fields {
                    let jots = bits.row(field.frame, row * self.side + field.line);
                    let jots = &jots[first / 8 * self.side..];
                    append(jots, self.side, field.first, field.length, &mut codes);
                }
                let planes = out.chunks_exact_mut(place.pixels());
                for (plane, table) in planes.zip(&group.tables) {
                    let sums = &mut plane[line * width..][..width];
                    for (sum, &code) in sums.iter_mut().zip(&codes[skipped..]) {
                        *sum += table[code as usize];
                    }
                }
            }
        }
    }
}

/// p of whole filters, one plane per filter.
pub(super) fn block_filter<F: Real>(
    bits: &PackedBits<'_>,
    filters: ArrayView4<'_, F>,
    (height, width): (usize, usize),
) -> Array3<F> {
    let mut planes = Array3::zeros((filters.dim().0, height, width));
    if let Some(planes) = planes.as_slice_mut() {
        let whole = Place {
            rows: 0..height,
            columns: 0..width,
        };
        Tables::new(filters, height * width).fill(bits, &whole, planes);
    }
    planes
}

/// The fields of a block, in groups of at most [`PART`] bits.
fn groups(frames: usize, side: usize) -> Vec<Vec<Field>> {
    let mut groups: Vec<Vec<Field>> = Vec::new();
    let mut room = 0;
    for frame in 0..frames {
        for line in 0..side {
            for first in (0..side).step_by(PART) {
                let length = PART.min(side - first);
                if room < length {
                    groups.push(Vec::new());
                    room = PART;
                }
                room -= length;
                if let Some(group) = groups.last_mut() {
                    group.push(Field {
                        frame,
                        line,
                        first,
                        length,
                    });
                }
            }
        }
    }
    groups
}

/// Σ taps · bits for every number that the bits of some fields may be, the first of them the most significant.
fn table<F: Real>(fields: &[Field], taps: ArrayView3<'_, F>) -> Vec<F> {
    let mut table = vec![F::zero()];
    for field in fields.iter().rev() {
        for place in (field.first..field.first + field.length).rev() {
            let tap = taps[[field.frame, field.line, place]];
            table.extend_from_within(..);
            let half = table.len() / 2;
            for sum in &mut table[half..] {
                *sum += tap;
            }
        }
    }
    table
}

levels! {
    /// Appends `length` jots of each pixel's `side`, from number `first` on, to the code of the pixel.
    fn append(
        bytes: &[u8], side: usize, first: usize, length: usize, codes: &mut [u32],
    ) = append_inlined;
}

#[inline(always)]
fn append_inlined(bytes: &[u8], side: usize, first: usize, length: usize, codes: &mut [u32]) {
    match (side, length) {
        (1, 1) => append_shares_of_bytes::<8>(bytes, codes),
        (2, 2) => append_shares_of_bytes::<4>(bytes, codes),
        (4, 4) => append_shares_of_bytes::<2>(bytes, codes),
        (8, 8) => append_shares_of_bytes::<1>(bytes, codes),
        _ => {
            for (pixel, code) in codes.iter_mut().enumerate() {
                *code = *code << length | field(bytes, pixel * side + first, length) as u32;
            }
        }
    }
}

/// Of pixels of which so many share a byte.
#[inline(always)]
fn append_shares_of_bytes<const PIXELS: usize>(bytes: &[u8], codes: &mut [u32]) {
    let width = 8 / PIXELS;
    let share =
        |byte: u8, pixel: usize| u32::from(byte) >> (8 - width * (pixel + 1)) & ((1 << width) - 1);
    let (whole, rest) = codes.as_chunks_mut::<PIXELS>();
    let last = whole.len();
    for (codes, &byte) in whole.iter_mut().zip(bytes) {
        for pixel in 0..PIXELS {
            codes[pixel] = codes[pixel] << width | share(byte, pixel);
        }
    }
    for (pixel, code) in rest.iter_mut().enumerate() {
        *code = *code << width | share(bytes[last], pixel);
    }
}
