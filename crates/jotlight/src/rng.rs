//! Random numbers by position: the generator is asked for the draw *at* a jot, not for the next one.
//!
//! ChaCha with 8 rounds (the `chacha20` crate) is keyed by the seed; the frame, row and colour channel choose one
//! of its 2⁶⁴ streams and the column a place in the stream. So a jot's bit is the same for any number of threads, in any
//! tile and in any window of frames.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};

use crate::error::{Error, Result};

/// The first column of every draw of a row is a multiple of this many jots: one cache line of the generator's output.
pub const ALIGNMENT: usize = 64;

const ROWS: usize = 1 << 24;
const FRAMES: usize = 1 << 32;
const CHANNELS: usize = 1 << 7;

/// The draws of one sensor and one seed.
pub struct JotRandom {
    generator: ChaCha8Rng,
}

impl JotRandom {
    /// Keyed by 256 bits of seed.
    #[must_use]
    pub fn new(seed: [u8; 32]) -> Self {
        Self {
            generator: ChaCha8Rng::from_seed(seed),
        }
    }

    /// Fills `draws` with the 16-bit draws of the jots of a row, from column `column` on, a multiple of [`ALIGNMENT`].
    pub fn draws(&mut self, place: RowPlace, column: usize, bytes: &mut [u8]) {
        debug_assert_eq!(column % ALIGNMENT, 0);
        self.generator.set_stream(place.stream);
        // Two draws fill one 32-bit word of the stream.
        self.generator.set_word_pos((column / 2) as u128);
        self.generator.fill_bytes(bytes);
    }

    /// 32 further bits of the jot at `column`, for the few whose first 16 did not decide.
    pub fn refinement(&mut self, place: RowPlace, column: usize) -> u32 {
        self.generator.set_stream(place.stream | 1 << 63);
        self.generator.set_word_pos(column as u128);
        self.generator.next_u32()
    }
}

/// A row of jots in a frame and colour channel.
#[derive(Clone, Copy, Debug)]
pub struct RowPlace {
    stream: u64,
}

impl RowPlace {
    /// The stream of a row of jots. The sizes were checked by [`check_size`].
    #[must_use]
    pub fn new(channel: usize, frame: usize, row: usize) -> Self {
        Self {
            stream: (channel as u64) << 56 | (frame as u64) << 24 | row as u64,
        }
    }
}

/// Checks that every jot has a place of its own.
///
/// # Errors
/// [`Error::Range`] past 2²⁴ rows of jots, 2³² frames or 2⁷ channels.
pub fn check_size(channel: usize, frames: usize, rows: usize) -> Result<()> {
    for (what, value, limit, expected) in [
        ("rows of jots", rows, ROWS, "at most 2^24"),
        ("frames", frames, FRAMES, "at most 2^32"),
        ("channel", channel + 1, CHANNELS, "at most 2^7"),
    ] {
        if value > limit {
            return Err(Error::range(what, expected, value));
        }
    }
    Ok(())
}
