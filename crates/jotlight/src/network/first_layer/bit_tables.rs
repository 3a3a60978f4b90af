//! The filters of the first layer over packed bits, equation (11), by table look-up.
//!
//! The bits of a pixel form an index. A table holds the filtered sum for every index. If a pixel
//! has many bits, several tables each hold the sums for a part of them.

use ndarray::{Array3, ArrayView3, ArrayView4};
use rayon::prelude::*;

use crate::bits::{PackedBits, bit_field};
use crate::cpu::levels;
use crate::interrupt;
use crate::network::spline::evaluate::Spline;
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::PlanesMut;
use crate::numbers::Real;

/// The maximum number of trials per pixel for which one table may hold the sums of all bits. The
/// table is only worthwhile if the image has at least twice as many pixels as the table has
/// entries.
const WHOLE_BLOCK_BITS: usize = 16;
/// The maximum number of bits per table if there are several tables.
const TABLE_BITS: usize = 10;

/// The number of table entries that a parallel task processes.
const ENTRIES_PER_TASK: usize = 1 << 13;

/// A run: consecutive jots in one row of a pixel, in one frame.
struct JotRun {
    frame: usize,
    row: usize,
    first: usize,
    length: usize,
}

/// The tables of the filters `(C, T, K̂, K̂)` of a layer.
pub(crate) struct BitTables<F> {
    /// The oversampling K̂.
    side: usize,
    tables: Vec<RunTable<F>>,
}

/// Some runs of a pixel, and a table of the filtered sums of their bits.
struct RunTable<F> {
    runs: Vec<JotRun>,
    /// For each channel, the sum for every index. The bits of the runs form the index.
    channels: Vec<Vec<F>>,
}

impl<F: Real> RunTable<F> {
    /// Return one table for the runs of both tables. Its entries are sums of an entry of each
    /// table, so one table leads to the same results as several.
    fn merge(mut self, other: Self) -> Self {
        for (table, other) in self.channels.iter_mut().zip(&other.channels) {
            let sums = |&first: &F| other.iter().map(move |&second| first + second);
            *table = table.iter().flat_map(sums).collect();
        }
        self.runs.extend(other.runs);
        self
    }
}

impl<F: Real> BitTables<F> {
    /// Return the tables for an image of `pixels` pixels.
    pub fn new(filters: ArrayView4<'_, F>, pixels: usize) -> Self {
        let (_, frames, side, _) = filters.dim();
        let bits = frames * side * side;
        let use_one_table = bits <= WHOLE_BLOCK_BITS && pixels >= 2 << bits;
        let tables = divide_block(frames, side).into_iter().map(|runs| {
            let channels = filters.outer_iter().map(|taps| sums_of_runs(&runs, taps));
            let channels = channels.collect();
            RunTable { runs, channels }
        });
        let mut tables: Vec<_> = tables.collect();
        if use_one_table {
            tables = tables
                .into_iter()
                .reduce(RunTable::merge)
                .into_iter()
                .collect();
        }
        Self { side, tables }
    }

    /// Replace p with φ(p) in the table if there is only one table. Return whether there is only
    /// one.
    pub fn activate(&mut self, splines: &[Spline<F>]) -> bool {
        let [table] = &mut self.tables[..] else {
            return false;
        };
        for (spline, values) in splines.iter().zip(&mut table.channels) {
            values
                .par_chunks_mut(ENTRIES_PER_TASK)
                .for_each(|values| spline.apply(values));
        }
        true
    }

    /// Write p of a region of pixels, or φ(p) after [`BitTables::activate`], into `out`.
    pub fn filter(&self, bits: &PackedBits<'_>, region: &Region, out: &mut PlanesMut<'_, F>) {
        // Every eighth pixel begins with a whole byte, whatever the number of jots per pixel.
        let first = region.columns.start / 8 * 8;
        let mut indices = vec![0u32; region.columns.end - first];
        let skipped = region.columns.start - first;
        for (out_row, row) in region.rows.clone().enumerate() {
            if interrupt::is_requested() {
                return;
            }
            for (number, table) in self.tables.iter().enumerate() {
                indices.fill(0);
                for run in &table.runs {
                    let jots = bits.row(run.frame, row * self.side + run.row);
                    let jots = &jots[first / 8 * self.side..];
                    append_bits(jots, self.side, run.first, run.length, &mut indices);
                }
                for (plane, values) in table.channels.iter().enumerate() {
                    let sums = out.row(plane, out_row);
                    if number == 0 {
                        sums.fill(F::zero());
                    }
                    for (sum, &index) in sums.iter_mut().zip(&indices[skipped..]) {
                        *sum += values[index as usize];
                    }
                }
            }
        }
    }
}

/// Return p of all pixels: equation (11), one plane per filter.
pub(crate) fn filter_bits<F: Real>(
    bits: &PackedBits<'_>,
    filters: ArrayView4<'_, F>,
    (height, width): (usize, usize),
) -> Array3<F> {
    let mut planes = Array3::zeros((filters.dim().0, height, width));
    if let Some(planes) = planes.as_slice_mut() {
        let tables = BitTables::new(filters, height * width);
        let mut planes = PlanesMut::contiguous(planes, (height, width));
        tables.filter(bits, &Region::whole((height, width)), &mut planes);
    }
    planes
}

/// Return the runs of a pixel, divided into groups of at most [`TABLE_BITS`] bits.
fn divide_block(frames: usize, side: usize) -> Vec<Vec<JotRun>> {
    let mut groups: Vec<Vec<JotRun>> = Vec::new();
    let mut free_bits = 0;
    for frame in 0..frames {
        for row in 0..side {
            for first in (0..side).step_by(TABLE_BITS) {
                let length = TABLE_BITS.min(side - first);
                if free_bits < length {
                    groups.push(Vec::new());
                    free_bits = TABLE_BITS;
                }
                free_bits -= length;
                if let Some(group) = groups.last_mut() {
                    group.push(JotRun {
                        frame,
                        row,
                        first,
                        length,
                    });
                }
            }
        }
    }
    groups
}

/// Return Σ taps · bits for every index. The bits of the runs form the index, and the first bit is
/// the most significant one.
fn sums_of_runs<F: Real>(runs: &[JotRun], taps: ArrayView3<'_, F>) -> Vec<F> {
    let mut sums = vec![F::zero()];
    for run in runs.iter().rev() {
        for column in (run.first..run.first + run.length).rev() {
            let tap = taps[[run.frame, run.row, column]];
            sums.extend_from_within(..);
            let half = sums.len() / 2;
            for sum in &mut sums[half..] {
                *sum += tap;
            }
        }
    }
    sums
}

levels! {
    /// Append a run of each pixel to the index of the pixel.
    ///
    /// `bytes` is a row of jots. A pixel has `side` of them, and its run is `length` jots from the
    /// jot `first`.
    fn append_bits(
        bytes: &[u8], side: usize, first: usize, length: usize, indices: &mut [u32],
    ) = append_bits_inlined;
}

#[inline(always)]
fn append_bits_inlined(
    bytes: &[u8],
    side: usize,
    first: usize,
    length: usize,
    indices: &mut [u32],
) {
    match (side, length) {
        (1, 1) => append_whole_rows::<8>(bytes, indices),
        (2, 2) => append_whole_rows::<4>(bytes, indices),
        (4, 4) => append_whole_rows::<2>(bytes, indices),
        (8, 8) => append_whole_rows::<1>(bytes, indices),
        _ => {
            for (pixel, index) in indices.iter_mut().enumerate() {
                *index = *index << length | bit_field(bytes, pixel * side + first, length) as u32;
            }
        }
    }
}

/// Append a whole row of jots of each pixel to its index. `PIXELS` pixels fill one byte.
#[inline(always)]
fn append_whole_rows<const PIXELS: usize>(bytes: &[u8], indices: &mut [u32]) {
    let width = 8 / PIXELS;
    let jots =
        |byte: u8, pixel: usize| u32::from(byte) >> (8 - width * (pixel + 1)) & ((1 << width) - 1);
    let (whole, rest) = indices.as_chunks_mut::<PIXELS>();
    let last = whole.len();
    for (indices, &byte) in whole.iter_mut().zip(bytes) {
        for pixel in 0..PIXELS {
            indices[pixel] = indices[pixel] << width | jots(byte, pixel);
        }
    }
    for (pixel, index) in rest.iter_mut().enumerate() {
        *index = *index << width | jots(bytes[last], pixel);
    }
}
