//! What the processor can do at best, to which the speed of the engine is compared.

use rayon::prelude::*;

use crate::cpu::{self, Simd, WithSimd, levels};
use crate::numbers::Lanes;

/// Sums that are worked on in turn, more than a processor has under way.
const CHAINS: usize = 12;

/// Does nothing but fused multiply-adds of `f32` in registers, `rounds` times [`CHAINS`] registers on each thread; gives the number of floating-point
/// operations, two for each.
#[must_use]
pub fn multiply_adds(rounds: usize) -> u64 {
    (0..rayon::current_num_threads())
        .into_par_iter()
        .with_max_len(1)
        .map(|_| cpu::run(MultiplyAdds(rounds)))
        .sum()
}

struct MultiplyAdds(usize);

impl WithSimd for MultiplyAdds {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> u64 {
        let (factor, term) = (f32::splat(simd, 0.999_999), f32::splat(simd, 1e-7));
        let mut sums = [f32::splat(simd, 0.5); CHAINS];
        for _ in 0..self.0 {
            for sum in &mut sums {
                *sum = f32::multiply_add(simd, *sum, factor, term);
            }
        }
        std::hint::black_box(sums);
        2 * (self.0 * CHAINS * f32::lanes::<S>()) as u64
    }
}

/// The sum of many words, which takes as long as reading them.
#[must_use]
pub fn read(words: &[u64]) -> u64 {
    words
        .par_chunks(1 << 17)
        .map(|words| {
            let mut sum = 0;
            add(words, &mut sum);
            sum
        })
        .reduce(|| 0, u64::wrapping_add)
}

levels! {
    fn add(words: &[u64], sum: &mut u64) = add_inlined;
}

#[inline(always)]
fn add_inlined(words: &[u64], sum: &mut u64) {
    *sum = words.iter().fold(0, |sum, &word| sum.wrapping_add(word));
}
