//! ChaCha with 8 rounds (Bernstein, "ChaCha, a variant of Salsa20", 2008): sixteen blocks at a
//! time, one in each lane of the vectors.

use crate::cpu::{self, Simd, WithSimd};

/// The number of blocks that are computed together.
pub(super) const BLOCKS: usize = 16;

/// The number of 32-bit words of a block.
pub(super) const WORDS: usize = 16;

/// Sixteen blocks. Each row has the same word of all blocks.
pub(super) type Blocks = [[u32; BLOCKS]; WORDS];

/// The first four words of every state: "expand 32-byte k".
const CONSTANTS: [u32; 4] = [0x6170_7865, 0x3320_646e, 0x7962_2d32, 0x6b20_6574];

const DOUBLE_ROUNDS: usize = 4;

/// A 256-bit key.
#[derive(Clone, Copy, Debug)]
pub(super) struct Key([u32; 8]);

impl Key {
    pub fn new(bytes: [u8; 32]) -> Self {
        let words = bytes.as_chunks::<4>().0;
        Self(std::array::from_fn(|word| u32::from_le_bytes(words[word])))
    }

    /// Compute the blocks with the given counters of a stream.
    ///
    /// Only the first `number` blocks are needed. The others may keep their old content.
    pub fn compute(
        &self,
        stream: u64,
        counters: &[u64; BLOCKS],
        number: usize,
        blocks: &mut Blocks,
    ) {
        let mut halves = [[0; BLOCKS]; 2];
        for (block, &counter) in counters.iter().enumerate() {
            halves[0][block] = counter as u32;
            halves[1][block] = (counter >> 32) as u32;
        }
        cpu::run(Computation {
            key: self.0,
            counters: halves,
            stream: [stream as u32, (stream >> 32) as u32],
            number,
            blocks,
        });
    }
}

struct Computation<'a> {
    key: [u32; 8],
    /// The low and the high words of the counters.
    counters: [[u32; BLOCKS]; 2],
    stream: [u32; 2],
    number: usize,
    blocks: &'a mut Blocks,
}

impl WithSimd for Computation<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for part in 0..self.number.div_ceil(S::U32_LANES) {
            let start: [S::u32s; WORDS] = std::array::from_fn(|word| match word {
                0..4 => simd.splat_u32s(CONSTANTS[word]),
                4..12 => simd.splat_u32s(self.key[word - 4]),
                12..14 => S::as_simd_u32s(&self.counters[word - 12]).0[part],
                _ => simd.splat_u32s(self.stream[word - 14]),
            });
            let mut x = start;
            for _ in 0..DOUBLE_ROUNDS {
                // The columns, and then the diagonals. The words stay in registers only if their
                // indices are constants.
                x = quarter_round::<S, 0, 4, 8, 12>(simd, x);
                x = quarter_round::<S, 1, 5, 9, 13>(simd, x);
                x = quarter_round::<S, 2, 6, 10, 14>(simd, x);
                x = quarter_round::<S, 3, 7, 11, 15>(simd, x);
                x = quarter_round::<S, 0, 5, 10, 15>(simd, x);
                x = quarter_round::<S, 1, 6, 11, 12>(simd, x);
                x = quarter_round::<S, 2, 7, 8, 13>(simd, x);
                x = quarter_round::<S, 3, 4, 9, 14>(simd, x);
            }
            for word in 0..WORDS {
                S::as_mut_simd_u32s(&mut self.blocks[word]).0[part] =
                    simd.add_u32s(x[word], start[word]);
            }
        }
    }
}

/// Change four words of the state.
#[inline(always)]
fn quarter_round<S: Simd, const A: usize, const B: usize, const C: usize, const D: usize>(
    simd: S,
    mut x: [S::u32s; WORDS],
) -> [S::u32s; WORDS] {
    x[A] = simd.add_u32s(x[A], x[B]);
    x[D] = rotate::<16, S>(simd, simd.xor_u32s(x[D], x[A]));
    x[C] = simd.add_u32s(x[C], x[D]);
    x[B] = rotate::<12, S>(simd, simd.xor_u32s(x[B], x[C]));
    x[A] = simd.add_u32s(x[A], x[B]);
    x[D] = rotate::<8, S>(simd, simd.xor_u32s(x[D], x[A]));
    x[C] = simd.add_u32s(x[C], x[D]);
    x[B] = rotate::<7, S>(simd, simd.xor_u32s(x[B], x[C]));
    x
}

/// Rotate the bits of each word to the left. Compilers use an instruction for this, if one exists.
#[inline(always)]
fn rotate<const BITS: u32, S: Simd>(simd: S, words: S::u32s) -> S::u32s {
    let left = simd.wrapping_dyn_shl_u32s(words, simd.splat_u32s(BITS));
    let right = simd.wrapping_dyn_shr_u32s(words, simd.splat_u32s(32 - BITS));
    simd.or_u32s(left, right)
}
