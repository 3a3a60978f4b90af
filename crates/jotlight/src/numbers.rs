//! The floating-point types of the engine and their SIMD vectors.

use std::fmt::Debug;
use std::iter::Sum;

use ndarray::NdFloat;

use crate::cpu::Simd;

/// The floating-point type of a computation: `f32` or `f64`.
///
/// The public functions compute with `f32`. Tests run the same code with `f64` to obtain accurate
/// reference values, for example for finite differences.
pub trait Real: NdFloat + Sum<Self> + Default + Lanes {
    /// Return the value of this type that is nearest to `x`.
    fn from_f64(x: f64) -> Self;
    /// Return the same value as `f64`.
    fn as_f64(self) -> f64;
    /// Return a small integer as a value of this type.
    fn from_index(index: usize) -> Self;
    /// Return the integer nearest to a value in \[0, 2²²\], as this type and as an index.
    ///
    /// Compilers vectorize this code. They do not vectorize a cast with a check for overflow.
    fn nearest(self) -> (Self, u32);
    /// Return the slice as `f32`, or None for other types.
    fn as_f32_slice(values: &mut [Self]) -> Option<&mut [f32]>;
}

macro_rules! real {
    ($(($float:ty, $unit_ulp:expr, $as_f32_slice:expr)),*) => {$(
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
                // At this magnitude, the last bit of the mantissa is worth 1. The sum is therefore
                // rounded to an integer, and the low bits of the sum contain this integer.
                const UNIT_ULP: $float = $unit_ulp;
                let shifted = self + UNIT_ULP;
                (shifted - UNIT_ULP, shifted.to_bits() as u32 & 0x3f_ffff)
            }
            #[inline(always)]
            fn as_f32_slice(values: &mut [Self]) -> Option<&mut [f32]> {
                ($as_f32_slice)(values)
            }
        }
    )*};
}
real!(
    (f32, 8_388_608.0, Some),
    (f64, 4_503_599_627_370_496.0, |_| None)
);

/// The maximum number of values in a SIMD register.
pub const MAX_LANES: usize = 16;

/// A type with SIMD registers that hold several values.
pub trait Lanes: Copy {
    /// A register of values.
    type Vector<S: Simd>: Copy + Debug;
    /// Return the number of values in a register.
    fn lanes<S: Simd>() -> usize;
    /// Return the whole registers of a slice. The remainder is left out.
    fn vectors<S: Simd>(values: &[Self]) -> &[Self::Vector<S>];
    /// Return the whole registers of a mutable slice. The remainder is left out.
    fn vectors_mut<S: Simd>(values: &mut [Self]) -> &mut [Self::Vector<S>];
    /// Return a register with the same value in every lane.
    fn splat<S: Simd>(simd: S, value: Self) -> Self::Vector<S>;
    /// Return a·b + c. A processor with a fused multiply-add rounds the result only once.
    fn multiply_add<S: Simd>(
        simd: S,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
        c: Self::Vector<S>,
    ) -> Self::Vector<S>;
    /// Return the sum of the lanes of a register.
    fn reduce_sum<S: Simd>(simd: S, vector: Self::Vector<S>) -> Self;
    /// Return four registers of consecutive values, separated by their position in a group of four.
    ///
    /// The order of the groups depends on the instruction set, but not on the position.
    fn deinterleave<S: Simd>(simd: S, values: [Self::Vector<S>; 4]) -> [Self::Vector<S>; 4];
    /// Return the registers of which [`Lanes::deinterleave`] returns `values`.
    fn interleave<S: Simd>(simd: S, values: [Self::Vector<S>; 4]) -> [Self::Vector<S>; 4];
}

macro_rules! lanes {
    (
        $float:ty,
        $vector:ident,
        $lanes:ident,
        $slice:ident,
        $slice_mut:ident,
        $splat:ident,
        $multiply_add:ident,
        $reduce_sum:ident,
        $deinterleave:ident,
        $interleave:ident
    ) => {
        impl Lanes for $float {
            type Vector<S: Simd> = S::$vector;
            #[inline(always)]
            fn lanes<S: Simd>() -> usize {
                S::$lanes
            }
            #[inline(always)]
            fn vectors<S: Simd>(values: &[Self]) -> &[S::$vector] {
                S::$slice(values).0
            }
            #[inline(always)]
            fn vectors_mut<S: Simd>(values: &mut [Self]) -> &mut [S::$vector] {
                S::$slice_mut(values).0
            }
            #[inline(always)]
            fn splat<S: Simd>(simd: S, value: Self) -> S::$vector {
                simd.$splat(value)
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
            fn reduce_sum<S: Simd>(simd: S, vector: S::$vector) -> Self {
                simd.$reduce_sum(vector)
            }
            #[inline(always)]
            fn deinterleave<S: Simd>(simd: S, values: [S::$vector; 4]) -> [S::$vector; 4] {
                simd.$deinterleave(values)
            }
            #[inline(always)]
            fn interleave<S: Simd>(simd: S, values: [S::$vector; 4]) -> [S::$vector; 4] {
                simd.$interleave(values)
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
    reduce_sum_f32s,
    deinterleave_shfl_f32s,
    interleave_shfl_f32s
);
lanes!(
    f64,
    f64s,
    F64_LANES,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    mul_add_e_f64s,
    reduce_sum_f64s,
    deinterleave_shfl_f64s,
    interleave_shfl_f64s
);

/// The number of elements whose products are added before their sum is added to the total, which
/// keeps the rounding error small.
const ELEMENTS_PER_SUM: usize = 1 << 12;

/// The number of partial sums in a loop. The compiler adds as many products at the same time.
const PARTIAL_SUMS: usize = 16;

/// Return the inner product of two slices of the same length. It depends on nothing else.
#[must_use]
pub fn inner_product(a: &[f64], b: &[f64]) -> f64 {
    let chunks = a.chunks(ELEMENTS_PER_SUM).zip(b.chunks(ELEMENTS_PER_SUM));
    let sums = chunks.map(|(a, b)| {
        let (a_blocks, a_rest) = a.as_chunks::<PARTIAL_SUMS>();
        let (b_blocks, b_rest) = b.as_chunks::<PARTIAL_SUMS>();
        let mut sums = [0.0; PARTIAL_SUMS];
        for (a, b) in a_blocks.iter().zip(b_blocks) {
            for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
                *sum += a * b;
            }
        }
        let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
        sums.iter().sum::<f64>() + rest
    });
    sums.sum()
}

/// Return the median of numbers, or None if there are none. Their order changes.
pub(crate) fn median<F: Real>(numbers: &mut [F]) -> Option<F> {
    let order = |a: &F, b: &F| a.as_f64().total_cmp(&b.as_f64());
    let (length, middle) = (numbers.len(), numbers.len() / 2);
    if length == 0 {
        return None;
    }
    let (low, &mut upper, _) = numbers.select_nth_unstable_by(middle, order);
    let lower = low.iter().copied().max_by(order);
    let lower = lower.filter(|_| length.is_multiple_of(2)).unwrap_or(upper);
    Some(F::from_f64(f64::midpoint(lower.as_f64(), upper.as_f64())))
}

#[cfg(test)]
mod tests {
    use super::{inner_product, median};

    #[test]
    fn a_median_of_an_even_number_lies_between_the_middle_ones() {
        assert_eq!(median::<f32>(&mut []), None);
        assert_eq!(median(&mut [3.0_f32]), Some(3.0));
        assert_eq!(median(&mut [9.0, -1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [9.0, 4.0, 1.0, 2.0]), Some(3.0));
    }

    #[test]
    fn an_inner_product_is_the_sum_of_all_products() {
        for length in [0_u32, 1, 15, 16, 17, 4095, 4096, 4097, 10_000] {
            let a: Vec<_> = (0..length).map(|i| f64::from(i % 7) - 3.0).collect();
            let b: Vec<_> = (0..length).map(|i| f64::from(i % 5) + 0.5).collect();
            // The products are multiples of 1/2, so all sums are exact.
            let expected: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
            assert!((inner_product(&a, &b) - expected).abs() < 1e-9, "{length}");
        }
    }
}
