//! The width of the numbers that a network is run with.

use std::iter::Sum;

use ndarray::NdFloat;

use crate::cpu::Lanes;

/// `f32` for work; `f64` is the same code with errors too small to matter, which tells what the first should give.
pub trait Real: NdFloat + Sum<Self> + Default + Lanes {
    /// The nearest number of this width.
    fn from_f64(x: f64) -> Self;
    /// The same number in 64 bits.
    fn as_f64(self) -> f64;
    /// A small whole number.
    fn from_index(index: usize) -> Self;
    /// The nearest whole number, of 0 to 2²², as a number and as an index. Quick, since processors convert many at once
    /// only where it need not be checked that they fit.
    fn nearest(self) -> (Self, u32);
    /// The same numbers, if they are of 32 bits.
    fn as_f32s(numbers: &mut [Self]) -> Option<&mut [f32]>;
}

macro_rules! real {
    ($(($float:ty, $ones:expr, $as_f32s:expr)),*) => {$(
        impl Real for $float {
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as Self
            }
            #[inline(always)]
            fn as_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            #[allow(clippy::cast_lossless)]
            fn from_index(index: usize) -> Self {
                index as i32 as Self
            }
            #[inline(always)]
            fn nearest(self) -> (Self, u32) {
                // At this size the last bit of a number is worth 1.
                const ONES: $float = $ones;
                let shifted = self + ONES;
                (shifted - ONES, shifted.to_bits() as u32 & 0x3f_ffff)
            }
            #[inline(always)]
            fn as_f32s(numbers: &mut [Self]) -> Option<&mut [f32]> {
                ($as_f32s)(numbers)
            }
        }
    )*};
}
real!(
    (f32, 8_388_608.0, Some),
    (f64, 4_503_599_627_370_496.0, |_| None)
);
