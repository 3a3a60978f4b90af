//! The floating-point types of the engine.

use std::iter::Sum;

use ndarray::NdFloat;

use crate::lanes::Lanes;

/// The floating-point type of a computation: `f32` or `f64`.
///
/// The public functions compute with `f32`. Tests run the same code with `f64` to obtain accurate
/// reference values, for example for finite differences.
///
/// Other types cannot implement this trait, because its vectors are private to the crate.
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
