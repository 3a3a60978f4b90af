//! The width of the numbers that a network is run with.

use std::fmt::Debug;
use std::iter::Sum;

use ndarray::NdFloat;

use crate::cpu::Simd;

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

/// The most numbers that a register holds.
pub const LANES: usize = 16;

/// Numbers of which a register holds several.
pub trait Lanes: Copy {
    /// A register of them.
    type Vector<S: Simd>: Copy + Debug;
    /// How many it holds.
    fn lanes<S: Simd>() -> usize;
    /// Whole registers of a slice.
    fn vectors<S: Simd>(numbers: &[Self]) -> &[Self::Vector<S>];
    /// Whole registers of a slice.
    fn vectors_mut<S: Simd>(numbers: &mut [Self]) -> &mut [Self::Vector<S>];
    /// The same number in all places.
    fn splat<S: Simd>(simd: S, number: Self) -> Self::Vector<S>;
    /// a·b + c, rounded once where the processor does so at no cost.
    fn multiply_add<S: Simd>(
        simd: S,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
        c: Self::Vector<S>,
    ) -> Self::Vector<S>;
    /// The sum of a register.
    fn total<S: Simd>(simd: S, vector: Self::Vector<S>) -> Self;
}

macro_rules! lanes {
    ($number:ty, $vector:ident, $lanes:ident, $slice:ident, $slice_mut:ident, $splat:ident, $multiply_add:ident, $total:ident) => {
        impl Lanes for $number {
            type Vector<S: Simd> = S::$vector;
            #[inline(always)]
            fn lanes<S: Simd>() -> usize {
                S::$lanes
            }
            #[inline(always)]
            fn vectors<S: Simd>(numbers: &[Self]) -> &[S::$vector] {
                S::$slice(numbers).0
            }
            #[inline(always)]
            fn vectors_mut<S: Simd>(numbers: &mut [Self]) -> &mut [S::$vector] {
                S::$slice_mut(numbers).0
            }
            #[inline(always)]
            fn splat<S: Simd>(simd: S, number: Self) -> S::$vector {
                simd.$splat(number)
            }
            #[inline(always)]
            fn multiply_add<S: Simd>(
                simd: S,
                a: S::$vector,
                b: S::$vector,
                c: S::$vector,
            ) -> S::$vector {
                simd.$multiply_add(a, b, c)
            }
            #[inline(always)]
            fn total<S: Simd>(simd: S, vector: S::$vector) -> Self {
                simd.$total(vector)
            }
        }
    };
}
lanes!(
    f32,
    f32s,
    F32_LANES,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    mul_add_e_f32s,
    reduce_sum_f32s
);
lanes!(
    f64,
    f64s,
    F64_LANES,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    mul_add_e_f64s,
    reduce_sum_f64s
);
