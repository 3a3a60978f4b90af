//! Rows that the depth-to-space rearrangement combines.

use crate::cpu::levels;
use crate::numbers::Real;

levels! {
    /// Write the values of two rows alternately into `out`.
    pub(super) fn interleave[F: Real](even: &[F], odd: &[F], out: &mut [F]) = interleave_inlined;
}

/// Write the values of two rows alternately into `out`.
#[inline(always)]
pub(crate) fn interleave_inlined<F: Real>(even: &[F], odd: &[F], out: &mut [F]) {
    let (pairs, _) = out.as_chunks_mut::<2>();
    for ((pair, &even), &odd) in pairs.iter_mut().zip(even).zip(odd) {
        *pair = [even, odd];
    }
}
