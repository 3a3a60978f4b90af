//! The SIMD vectors of the floating-point types.

use std::fmt::Debug;

use crate::cpu::Simd;

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
