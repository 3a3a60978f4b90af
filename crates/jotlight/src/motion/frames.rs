//! The frames whose bits are counted along a motion.

use std::borrow::Cow;
use std::ops::Range;

use super::field::Displacements;
use super::search::Times;
use super::source::Frame;
use crate::bits::{FRAMES_PER_GROUP, packed_width};
use crate::error::{Error, Result};

/// The maximum number of rows and columns, up to which `f32` represents positions of pixels.
const MAX_SIZE: usize = 1 << 24;

/// The maximum number of bytes of a frame. Their indices are `i32`.
const MAX_FRAME_BYTES: usize = i32::MAX as usize;

/// The bits and their motion.
pub(super) struct Input<'a, 'b> {
    /// The bytes of each frame.
    pub bits: Vec<Cow<'a, [u8]>>,
    pub valid: Option<Cow<'a, [u8]>>,
    pub motion: &'a Displacements<'b>,
    /// The mean displacements of all frames.
    pub mean: Displacements<'static>,
    /// The time of each frame, from its [`Piece::field`] (0) to the next one (1).
    pub times: Vec<f32>,
    pub pieces: Vec<Piece>,
    pub frame: Frame,
}

/// Consecutive frames between the same two fields.
pub(super) struct Piece {
    /// The index of the first field.
    pub field: usize,
    pub frames: Range<usize>,
}

impl Piece {
    /// Divide frames, given their times between `fields` fields. Return also the times in a piece.
    pub fn divide(times: &[f64], fields: usize) -> (Vec<Self>, Vec<f32>) {
        let field = |time: f64| (time.max(0.0) as usize).min(fields.saturating_sub(2));
        let mut pieces = Vec::new();
        let mut start = 0;
        for part in times.chunk_by(|&a, &b| field(a) == field(b)) {
            let frames = start..start + part.len();
            start = frames.end;
            let field = field(part[0]);
            pieces.push(Self { field, frames });
        }
        let fraction = |&time: &f64| (time - field(time) as f64) as f32;
        (pieces, times.iter().map(fraction).collect())
    }

    /// Return the mean share of each of the fields in the displacements of all frames.
    pub fn shares(pieces: &[Self], times: &[f32], fields: usize) -> Vec<f64> {
        let mut shares = vec![0.0; fields];
        for piece in pieces {
            for &time in &times[piece.frames.clone()] {
                let share = f64::from(time) / times.len() as f64;
                shares[piece.field] += 1.0 / times.len() as f64 - share;
                shares[(piece.field + 1).min(fields - 1)] += share;
            }
        }
        shares
    }
}

/// A group of frames.
pub(super) struct Frames<'a> {
    pub times: Times,
    /// The bytes of each frame. The last one fills the rest.
    pub bytes: [&'a [u8]; FRAMES_PER_GROUP],
    /// Their indices in the group.
    pub indices: [usize; FRAMES_PER_GROUP],
}

impl<'a> Frames<'a> {
    /// Return the group that begins with a frame, before the frame `end`.
    pub fn new(input: &'a Input<'_, '_>, first: usize, end: usize) -> Self {
        let last = (first + FRAMES_PER_GROUP).min(end) - 1;
        let mut frames = Self {
            times: Times {
                number: last + 1 - first,
                each: [input.times[last]; FRAMES_PER_GROUP],
                range: [input.times[last]; 2],
            },
            bytes: [&input.bits[last][..]; FRAMES_PER_GROUP],
            indices: std::array::from_fn(|index| index),
        };
        for index in 0..frames.times.number {
            let time = input.times[first + index];
            let [low, high] = frames.times.range;
            frames.times.each[index] = time;
            frames.times.range = [low.min(time), high.max(time)];
            frames.bytes[index] = &input.bits[first + index];
        }
        frames
    }

    /// Return one or more of the frames, given their indices.
    #[inline(always)]
    pub fn some(&self, indices: &[usize]) -> Self {
        let first = self.times.each[indices[0]];
        let mut frames = Self {
            times: Times {
                number: indices.len(),
                each: [first; FRAMES_PER_GROUP],
                range: [first; 2],
            },
            bytes: self.bytes,
            indices: self.indices,
        };
        for (target, &index) in indices.iter().enumerate() {
            let time = self.times.each[index];
            let [low, high] = frames.times.range;
            frames.times.each[target] = time;
            frames.times.range = [low.min(time), high.max(time)];
            frames.bytes[target] = self.bytes[index];
            frames.indices[target] = self.indices[index];
        }
        frames
    }
}

/// Check that positions of jots and indices of bytes can be represented.
pub(super) fn check_size(rows: usize, columns: usize) -> Result<()> {
    if rows.max(columns) > MAX_SIZE || rows * packed_width(columns) > MAX_FRAME_BYTES {
        let expected = format!("at most {MAX_SIZE} rows and columns, and {MAX_FRAME_BYTES} bytes");
        let received = format!("{rows} x {columns}");
        return Err(Error::range("frames", expected, received));
    }
    Ok(())
}

/// Check that times are near those of the fields.
pub(super) fn check_times(times: &[f64], fields: usize) -> Result<()> {
    let range = -1.0..=fields as f64;
    match times.iter().find(|time| !range.contains(*time)) {
        Some(time) => Err(Error::range(
            "times of the frames",
            format!("-1 to {fields}"),
            time,
        )),
        None => Ok(()),
    }
}
