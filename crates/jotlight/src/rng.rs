//! Random numbers by position: each jot of each frame has its own position in a random stream.
//!
//! The generator is ChaCha with 8 rounds (the `chacha20` crate), and the seed is its key. It has
//! 2⁶⁴ streams. The frame, the row, and the color channel select a stream, and the column selects a
//! position in the stream. Therefore a jot has the same bit for any number of threads, in any tile,
//! and in any range of frames.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};

use crate::error::{Error, Result};

/// The divisor of the first column of a row of draws. The bits of 64 columns fill one word.
pub const ALIGNMENT: usize = 64;

/// The number of random bytes for the read noise of a jot.
pub const NOISE_BYTES: usize = 16;

const MAX_ROWS: usize = 1 << 24;
const MAX_FRAMES: usize = 1 << 32;
const MAX_CHANNELS: usize = 1 << 7;

/// The random numbers of all jots for one seed.
pub struct JotRandom {
    generator: ChaCha8Rng,
}

impl JotRandom {
    /// Return the generator for a seed of 256 bits.
    #[must_use]
    pub fn new(seed: [u8; 32]) -> Self {
        Self {
            generator: ChaCha8Rng::from_seed(seed),
        }
    }

    /// Fill `bytes` with the 16-bit draws of the jots of a row.
    ///
    /// The draws start at `column`, which must be a multiple of [`ALIGNMENT`].
    pub fn fill_draws(&mut self, stream: RowStream, column: usize, bytes: &mut [u8]) {
        debug_assert_eq!(column % ALIGNMENT, 0);
        self.generator.set_stream(stream.number);
        // Two draws fill one 32-bit word of the stream.
        self.generator.set_word_pos((column / 2) as u128);
        self.generator.fill_bytes(bytes);
    }

    /// Return 32 more random bits for the jot at `column`.
    ///
    /// They are needed only if the first 16 bits do not decide the jot's bit, which is rare.
    pub fn refinement(&mut self, stream: RowStream, column: usize) -> u32 {
        self.generator.set_stream(stream.number | 1 << 63);
        self.generator.set_word_pos(column as u128);
        self.generator.next_u32()
    }

    /// Fill `bytes` with the [`Self::refinement`] of each jot of a row from `column` on.
    pub fn fill_refinements(&mut self, stream: RowStream, column: usize, bytes: &mut [u8]) {
        self.generator.set_stream(stream.number | 1 << 63);
        self.generator.set_word_pos(column as u128);
        self.generator.fill_bytes(bytes);
    }

    /// Fill `bytes` with [`NOISE_BYTES`] for each jot of a row from `column` on.
    pub fn fill_noise(&mut self, stream: RowStream, column: usize, bytes: &mut [u8]) {
        self.generator.set_stream(stream.number | 1 << 63);
        // Refinements are before this position, because a row has fewer than 2³² jots.
        self.generator
            .set_word_pos((1 << 32) + (column * NOISE_BYTES / 4) as u128);
        self.generator.fill_bytes(bytes);
    }
}

/// The stream of random numbers of one row of jots in one frame and color channel.
#[derive(Clone, Copy, Debug)]
pub struct RowStream {
    number: u64,
}

impl RowStream {
    /// Return the stream of a row. The caller must have called [`check_size`].
    #[must_use]
    pub fn new(channel: usize, frame: usize, row: usize) -> Self {
        Self {
            number: (channel as u64) << 56 | (frame as u64) << 24 | row as u64,
        }
    }
}

/// Check that every jot has its own position in the random streams.
///
/// `channel` is the index of a color channel, and `frames` and `rows` are numbers.
///
/// # Errors
/// [`Error::Range`] for more than 2²⁴ rows of jots, 2³² frames, or 2⁷ channels.
pub fn check_size(channel: usize, frames: usize, rows: usize) -> Result<()> {
    for (what, value, limit, expected) in [
        ("rows of jots", rows, MAX_ROWS, "at most 2^24"),
        ("frames", frames, MAX_FRAMES, "at most 2^32"),
        ("channel", channel, MAX_CHANNELS - 1, "less than 2^7"),
    ] {
        if value > limit {
            return Err(Error::range(what, expected, value));
        }
    }
    Ok(())
}
