//! Comparison of random draws of 8 bits with bounds of probabilities, 64 jots at a time.

#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};
#[cfg(target_arch = "x86_64")]
use pulp::{Simd, WithSimd, cast};

#[cfg(target_arch = "x86_64")]
use crate::cpu;
use crate::cpu::levels;

/// For 64 jots each: the draws, and their bounds.
#[derive(Clone, Copy)]
pub(super) struct Draws<'a> {
    pub values: &'a [[u8; 64]],
    /// A jot whose draw is below this bound reports 1.
    pub lower: &'a [[u8; 64]],
    /// A jot whose draw is above this bound reports 0.
    pub upper: &'a [[u8; 64]],
}

/// Write a word for each 64 draws: the bits of the draws below the lower bound, and of those that
/// the bounds do not decide. The first draw is the least significant bit.
pub(super) fn compare(draws: Draws<'_>, words: &mut [u64], undecided: &mut [u64]) {
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(simd) = cpu::v4() {
            return cpu::run(Comparison {
                simd,
                draws,
                words,
                undecided,
            });
        }
        if let Some(simd) = cpu::v3() {
            return cpu::run(Comparison {
                simd,
                draws,
                words,
                undecided,
            });
        }
    }
    compare_portably(draws, words, undecided);
}

levels! {
    fn compare_portably(
        draws: Draws<'_>, words: &mut [u64], undecided: &mut [u64],
    ) = compare_inlined;
    /// Reverse the bits of words.
    pub(super) fn reverse(words: &mut [u64]) = reverse_inlined;
}

impl Draws<'_> {
    /// Write words that a function computes from 64 draws and their bounds.
    #[inline(always)]
    fn for_each_word(
        self,
        words: &mut [u64],
        undecided: &mut [u64],
        compare: impl Fn(&[u8; 64], &[u8; 64], &[u8; 64]) -> (u64, u64),
    ) {
        let bounds = self.lower.iter().zip(self.upper);
        let out = words.iter_mut().zip(undecided);
        for ((draws, (lower, upper)), (word, undecided)) in self.values.iter().zip(bounds).zip(out)
        {
            let (below_lower, up_to_upper) = compare(draws, lower, upper);
            *word = below_lower;
            *undecided = up_to_upper & !below_lower;
        }
    }
}

#[cfg(target_arch = "x86_64")]
struct Comparison<'a, S> {
    simd: S,
    draws: Draws<'a>,
    words: &'a mut [u64],
    undecided: &'a mut [u64],
}

#[cfg(target_arch = "x86_64")]
impl WithSimd for Comparison<'_, V4> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let avx512bw = self.simd.avx512bw;
        self.draws
            .for_each_word(self.words, self.undecided, |&draws, &lower, &upper| {
                (
                    avx512bw._mm512_cmplt_epu8_mask(cast(draws), cast(lower)),
                    avx512bw._mm512_cmple_epu8_mask(cast(draws), cast(upper)),
                )
            });
    }
}

#[cfg(target_arch = "x86_64")]
impl WithSimd for Comparison<'_, V3> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let avx2 = self.simd.avx2;
        let bits = |mask| u64::from(avx2._mm256_movemask_epi8(mask).cast_unsigned());
        self.draws
            .for_each_word(self.words, self.undecided, |&draws, &lower, &upper| {
                let [draws, lower, upper]: [[_; 2]; 3] = [cast(draws), cast(lower), cast(upper)];
                let (mut below_lower, mut up_to_upper) = (0, 0);
                for half in (0..2).rev() {
                    // No instruction compares integers without a sign, but max and min exist.
                    let max = avx2._mm256_max_epu8(draws[half], lower[half]);
                    let from_lower = avx2._mm256_cmpeq_epi8(max, draws[half]);
                    let min = avx2._mm256_min_epu8(draws[half], upper[half]);
                    let to_upper = avx2._mm256_cmpeq_epi8(min, draws[half]);
                    below_lower = below_lower << 32 | (bits(from_lower) ^ 0xffff_ffff);
                    up_to_upper = up_to_upper << 32 | bits(to_upper);
                }
                (below_lower, up_to_upper)
            });
    }
}

#[inline(always)]
fn compare_inlined(draws: Draws<'_>, words: &mut [u64], undecided: &mut [u64]) {
    draws.for_each_word(words, undecided, |draws, lower, upper| {
        let (mut below_lower, mut up_to_upper) = ([0; 64], [0; 64]);
        for jot in 0..64 {
            below_lower[jot] = u8::from(draws[jot] < lower[jot]);
            up_to_upper[jot] = u8::from(draws[jot] <= upper[jot]);
        }
        (pack(&below_lower), pack(&up_to_upper))
    });
}

/// Return a word of 64 bits from 64 bytes of 0 or 1. The first byte is the least significant bit.
#[inline(always)]
fn pack(bits: &[u8; 64]) -> u64 {
    bits.as_chunks::<8>().0.iter().rfold(0, |word, &eight| {
        // The multiplication collects the lowest bit of each byte in the highest byte.
        let byte = u64::from_le_bytes(eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        word << 8 | byte
    })
}

#[inline(always)]
fn reverse_inlined(words: &mut [u64]) {
    for word in words {
        *word = word.reverse_bits();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_those_of_the_definition() {
        let mut state = 1u32;
        let mut byte = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        // Few different values, so that draws often equal their bounds.
        let mut block = || -> [u8; 64] { std::array::from_fn(|_| byte() >> 4 << 4) };
        let [draws, lower, upper] = [0; 3].map(|_| [(); 20].map(|()| block()));
        let arguments = Draws {
            values: &draws,
            lower: &lower,
            upper: &upper,
        };
        for portable in [false, true] {
            let (mut words, mut undecided) = ([0; 20], [0; 20]);
            if portable {
                compare_portably(arguments, &mut words, &mut undecided);
            } else {
                compare(arguments, &mut words, &mut undecided);
            }
            for word in 0..20 {
                for jot in 0..64 {
                    let draw = draws[word][jot];
                    let one = draw < lower[word][jot];
                    assert_eq!(words[word] >> jot & 1 == 1, one);
                    let close = !one && draw <= upper[word][jot];
                    assert_eq!(undecided[word] >> jot & 1 == 1, close);
                }
            }
        }
    }
}
