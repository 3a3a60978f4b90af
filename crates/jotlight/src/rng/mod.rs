//! Random numbers by position: each jot of each frame has its own position in a random stream.
//!
//! The generator is ChaCha with 8 rounds, and the seed is its key. It has 2⁶⁴ streams. The frame,
//! the row, and the color channel select a stream, and the column selects a position in the stream.
//! Therefore a jot has the same bit for any number of threads, in any tile, and in any range of
//! frames.

mod chacha;

use crate::error::{Error, Result};
use chacha::{BLOCKS, Blocks, Key, WORDS};

/// The number of jots whose draws are computed together. A row of draws begins at a multiple.
pub const ALIGNMENT: usize = BLOCKS_PER_GROUP * 64;

/// A group of [`ALIGNMENT`] draws interleaves the words of eight blocks, so that the vectors of
/// every instruction set can be stored without a transposition.
const BLOCKS_PER_GROUP: usize = 8;

/// The number of jots whose [`JotRandom::refinements`] one block contains.
const REFINEMENTS_PER_BLOCK: usize = 8;

/// The number of random bytes for the read noise of a jot.
pub const NOISE_BYTES: usize = 16;

const NOISE_PER_BLOCK: usize = 4 * WORDS / NOISE_BYTES;

/// The first block of read noise. Refinements are before it, because a row has fewer than 2⁴⁰ jots.
const FIRST_NOISE_BLOCK: u64 = 1 << 40;

/// The number of jots whose refinements are computed together.
pub const MAX_REFINEMENTS: usize = BLOCKS;

/// The number of random numbers that [`JotRandom::uniforms`] returns.
pub const UNIFORMS: usize = BLOCKS * WORDS / 2;

/// The first block of uniform random numbers for counts, behind the read noise.
const FIRST_UNIFORM_BLOCK: u64 = 1 << 44;

/// The number of bits of a refinement.
pub const REFINEMENT_BITS: u32 = 40;

const MAX_ROWS: usize = 1 << 24;
const MAX_FRAMES: usize = 1 << 32;
const MAX_CHANNELS: usize = 1 << 7;

/// The random numbers of all jots for one seed.
pub struct JotRandom {
    key: Key,
    blocks: Box<Blocks>,
}

impl JotRandom {
    /// Return the generator for a seed of 256 bits.
    #[must_use]
    pub fn new(seed: [u8; 32]) -> Self {
        Self {
            key: Key::new(seed),
            blocks: Box::new([[0; BLOCKS]; WORDS]),
        }
    }

    /// Fill `draws` with the draws of 8 bits of the jots of a row.
    ///
    /// The draws start at `column`, which must be a multiple of [`ALIGNMENT`].
    pub fn fill_draws(&mut self, stream: RowStream, column: usize, draws: &mut [[u8; ALIGNMENT]]) {
        debug_assert_eq!(column % ALIGNMENT, 0);
        let mut first = (column / 64) as u64;
        for groups in draws.chunks_mut(BLOCKS / BLOCKS_PER_GROUP) {
            self.compute(stream.draws(), first, groups.len() * BLOCKS_PER_GROUP);
            first += BLOCKS as u64;
            for (group, out) in groups.iter_mut().enumerate() {
                let parts = out.as_chunks_mut::<{ 4 * BLOCKS_PER_GROUP }>().0;
                for (part, word) in parts.iter_mut().zip(self.blocks.iter()) {
                    let words = word.as_chunks::<BLOCKS_PER_GROUP>().0[group];
                    for (bytes, word) in part.as_chunks_mut::<4>().0.iter_mut().zip(words) {
                        *bytes = word.to_le_bytes();
                    }
                }
            }
        }
    }

    /// Return the other 40 bits of the uniform random numbers of up to [`MAX_REFINEMENTS`] jots of a
    /// row.
    ///
    /// They are needed only if the first 8 bits do not decide a jot's bit, which is rare.
    pub fn refinements(&mut self, stream: RowStream, columns: &[usize]) -> [u64; MAX_REFINEMENTS] {
        let mut counters = [0; BLOCKS];
        for (counter, column) in counters.iter_mut().zip(columns) {
            *counter = (column / REFINEMENTS_PER_BLOCK) as u64;
        }
        let number = columns.len();
        self.key
            .compute(stream.others(), &counters, number, &mut self.blocks);
        let mut refinements = [0; BLOCKS];
        for (block, (out, column)) in refinements.iter_mut().zip(columns).enumerate() {
            let place = 2 * (column % REFINEMENTS_PER_BLOCK);
            let [low, high] = [place, place + 1].map(|word| u64::from(self.blocks[word][block]));
            *out = (high << 32 | low) >> (64 - REFINEMENT_BITS);
        }
        refinements
    }

    /// Fill `bytes` with [`NOISE_BYTES`] for each jot of a row from `column` on.
    pub fn fill_noise(
        &mut self,
        stream: RowStream,
        column: usize,
        bytes: &mut [[u8; NOISE_BYTES]],
    ) {
        let mut bytes = bytes.iter_mut();
        let mut skipped = column % NOISE_PER_BLOCK;
        let mut first = FIRST_NOISE_BLOCK + (column / NOISE_PER_BLOCK) as u64;
        while bytes.len() > 0 {
            self.compute(stream.others(), first, BLOCKS);
            first += BLOCKS as u64;
            let places = (0..BLOCKS * NOISE_PER_BLOCK).skip(std::mem::take(&mut skipped));
            for (place, bytes) in places.zip(&mut bytes) {
                let (block, jot) = (place / NOISE_PER_BLOCK, place % NOISE_PER_BLOCK);
                for (word, bytes) in bytes.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                    *bytes = self.blocks[jot * NOISE_BYTES / 4 + word][block].to_le_bytes();
                }
            }
        }
    }

    /// Return the uniform random numbers of 64 bits with a given number in a stream, in groups of
    /// [`UNIFORMS`].
    pub fn uniforms(&mut self, stream: RowStream, group: usize) -> [u64; UNIFORMS] {
        let first = FIRST_UNIFORM_BLOCK + (group * BLOCKS) as u64;
        self.compute(stream.others(), first, BLOCKS);
        let mut uniforms = [0; UNIFORMS];
        let pairs = self.blocks.as_chunks::<2>().0;
        for (out, [low, high]) in uniforms.as_chunks_mut::<BLOCKS>().0.iter_mut().zip(pairs) {
            for block in 0..BLOCKS {
                out[block] = u64::from(high[block]) << 32 | u64::from(low[block]);
            }
        }
        uniforms
    }

    /// Compute up to [`BLOCKS`] consecutive blocks of a stream.
    fn compute(&mut self, stream: u64, first: u64, number: usize) {
        let mut counters = [first; BLOCKS];
        for (block, counter) in counters.iter_mut().enumerate() {
            *counter += block as u64;
        }
        self.key
            .compute(stream, &counters, number, &mut self.blocks);
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

    /// Return the number of the stream of the draws.
    fn draws(self) -> u64 {
        self.number
    }

    /// Return the number of the stream of all other random numbers.
    fn others(self) -> u64 {
        self.number | 1 << 63
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
