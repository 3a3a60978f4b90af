//! The frames whose bits are counted along a motion.

use std::borrow::Cow;

use super::field::Displacements;
use super::search::Times;
use super::source::Frame;
use crate::bits::FRAMES_PER_GROUP;

/// The bits and their motion.
pub(super) struct Input<'a, 'b> {
    pub bits: Cow<'a, [u8]>,
    pub valid: Option<Cow<'a, [u8]>>,
    pub motion: &'a Displacements<'b>,
    pub times: &'a [f32],
    pub frame: Frame,
}

/// A group of frames.
pub(super) struct Frames<'a> {
    pub times: Times,
    /// The bytes of each frame and of all that follow it. The last one fills the rest.
    pub bytes: [&'a [u8]; FRAMES_PER_GROUP],
}

impl<'a> Frames<'a> {
    /// Return the group that begins with a frame.
    pub fn new(input: &'a Input<'_, '_>, first: usize) -> Self {
        let frame_bytes = input.frame.rows * input.frame.row_bytes();
        let last = (first + FRAMES_PER_GROUP).min(input.times.len()) - 1;
        let mut frames = Self {
            times: Times {
                number: last + 1 - first,
                each: [input.times[last]; FRAMES_PER_GROUP],
                range: [input.times[last]; 2],
            },
            bytes: [&input.bits[last * frame_bytes..]; FRAMES_PER_GROUP],
        };
        for index in 0..frames.times.number {
            let time = input.times[first + index];
            let [low, high] = frames.times.range;
            frames.times.each[index] = time;
            frames.times.range = [low.min(time), high.max(time)];
            frames.bytes[index] = &input.bits[(first + index) * frame_bytes..];
        }
        frames
    }
}
