//! Rounding, and functions of numbers that the compiler vectorizes.

/// The sum of a displacement and this number has the rounded displacement in its last bits, because
/// at this magnitude, the last bit of the mantissa is worth 1.
const UNIT_ULP: f32 = 12_582_912.0;

/// Return x, rounded to the nearest whole number, for |x| < 2²². Halves become even numbers.
#[inline(always)]
pub(super) fn round(x: f32) -> i32 {
    let bits = (x + UNIT_ULP).to_bits();
    bits.wrapping_sub(UNIT_ULP.to_bits()).cast_signed()
}

/// Combine all of eight values. The compiler vectorizes this, in contrast to one after the other.
#[inline(always)]
pub(super) fn fold<T: Copy + Default>(values: &[T; 8], combine: impl Fn(T, T) -> T) -> T {
    let values: [T; 4] = fold_halves(values, &combine);
    let values: [T; 2] = fold_halves(&values, &combine);
    combine(values[0], values[1])
}

/// Combine the first half of some values with the second one.
#[inline(always)]
pub(super) fn fold_halves<T: Copy + Default, const FROM: usize, const TO: usize>(
    values: &[T; FROM],
    combine: &impl Fn(T, T) -> T,
) -> [T; TO] {
    let mut combined = [T::default(); TO];
    for i in 0..TO {
        combined[i] = combine(values[i], values[TO + i]);
    }
    combined
}

/// Return the larger one of two numbers that are not NaN.
#[inline(always)]
pub(super) fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Return the smaller one of two numbers that are not NaN.
#[inline(always)]
pub(super) fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Return the sum of a difference and of errors of rounding of numbers up to a magnitude.
#[inline(always)]
pub(super) fn margin(difference: f32, magnitude: f32) -> f32 {
    // Each of a few roundings causes an error of up to 2^-24 of the largest value.
    difference + 1e-6 * (2.0 + magnitude)
}
