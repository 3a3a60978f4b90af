//! Measurements of the processor's peak speed. The benchmarks compare the engine with it.

use rayon::prelude::*;

use crate::cpu::{self, Simd, WithSimd, levels};
use crate::interrupt;
use crate::lanes::Lanes;

/// The number of independent sums. It exceeds the number of multiply-adds that a processor executes
/// at the same time, so no multiply-add waits for another.
const INDEPENDENT_SUMS: usize = 12;

/// Run fused multiply-adds of `f32` registers and return the number of floating-point operations.
///
/// Each thread performs `rounds` × 12 multiply-adds of a register. A multiply-add counts as two
/// operations per number in the register.
#[must_use]
pub fn multiply_adds(rounds: usize) -> u64 {
    (0..rayon::current_num_threads())
        .into_par_iter()
        .with_max_len(1)
        .map(|_| cpu::run(MultiplyAdds(rounds)))
        .reduce(|| 0, u64::saturating_add)
}

struct MultiplyAdds(usize);

impl WithSimd for MultiplyAdds {
    type Output = u64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> u64 {
        let (factor, term) = (f32::splat(simd, 0.999_999), f32::splat(simd, 1e-7));
        let mut sums = [f32::splat(simd, 0.5); INDEPENDENT_SUMS];
        for round in 0..self.0 {
            if round % (1 << 16) == 0 && interrupt::is_requested() {
                break;
            }
            for sum in &mut sums {
                *sum = f32::multiply_add(simd, *sum, factor, term);
            }
        }
        std::hint::black_box(sums);
        let operations_per_round = 2 * INDEPENDENT_SUMS * f32::lanes::<S>();
        self.0.saturating_mul(operations_per_round) as u64
    }
}

/// Return the wrapping sum of `words`. Reading the words takes longer than adding them, so the
/// duration of the call measures the memory bandwidth.
#[must_use]
pub fn read_words(words: &[u64]) -> u64 {
    words
        .par_chunks(1 << 17)
        .map(|words| {
            let mut sum = 0;
            if interrupt::is_requested() {
                return sum;
            }
            sum_words(words, &mut sum);
            sum
        })
        .reduce(|| 0, u64::wrapping_add)
}

levels! {
    fn sum_words(words: &[u64], sum: &mut u64) = sum_words_inlined;
}

#[inline(always)]
fn sum_words_inlined(words: &[u64], sum: &mut u64) {
    *sum = words.iter().fold(0, |sum, &word| sum.wrapping_add(word));
}
