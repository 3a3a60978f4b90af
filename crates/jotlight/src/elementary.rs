//! Elementary functions of groups of numbers.
//!
//! The loops run over groups of a fixed number of elements, so the compiler vectorizes them.

/// The number of elements in a group.
pub(crate) const ELEMENTS_PER_GROUP: usize = 16;
pub(crate) type Group = [f64; ELEMENTS_PER_GROUP];

/// ln 2 is the sum of both numbers. The product of the first one and a small integer is exact.
const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// Return e^x − 1 for x ≥ 0, accurate to a few units in the last place. An x above 709 is replaced
/// by 709.
///
/// If x = k ln 2 + r and |r| ≤ ½ ln 2, then e^x − 1 = 2^k (e^r − 1) + (2^k − 1). The Taylor series
/// of e^r − 1 is evaluated up to its 13th term.
#[inline(always)]
pub(crate) fn exp_m1(x: &Group) -> Group {
    // After this constant is added, the lowest bits of the sum contain the nearest integer.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    const SERIES: [f64; 12] = [
        1.0 / 6_227_020_800.0,
        1.0 / 479_001_600.0,
        1.0 / 39_916_800.0,
        1.0 / 3_628_800.0,
        1.0 / 362_880.0,
        1.0 / 40_320.0,
        1.0 / 5_040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
    ];
    let mut result = [0.0; ELEMENTS_PER_GROUP];
    for lane in 0..ELEMENTS_PER_GROUP {
        let x = x[lane].min(709.0);
        let shifted = x * std::f64::consts::LOG2_E + SHIFT;
        let k = shifted - SHIFT;
        let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
        let mut sum = SERIES[0];
        for coefficient in &SERIES[1..] {
            sum = sum * r + coefficient;
        }
        let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
        result[lane] = power * (r + r * r * sum) + (power - 1.0);
    }
    result
}

/// Return −log(1 − p), accurate to a few units in the last place. A p of 0 or less, or NaN, maps to
/// 0, and one of 1 or more to infinity.
///
/// If u = 1 − p = 2^k (1 + f) and 1 + f lies in [√½, √2), then log u = k ln 2 + log(1 + f). With
/// s = f / (2 + f), the series of log(1 + f) is 2s (1 + s²/3 + s⁴/5 + …). Its polynomial in s² is
/// that of the `log` function of FreeBSD. The rounding error of 1 − p is added in the end.
#[inline(always)]
pub(crate) fn minus_ln_1m(p: &Group) -> Group {
    const SQRT_HALF_BITS: u64 = 0x3fe6_a09e_667f_3bcd;
    const OFFSET: u64 = 2048;
    // The bits of this constant plus k are those of a number that is greater by k.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    const SERIES: [f64; 7] = [
        1.479_819_860_511_658_6e-1,
        1.531_383_769_920_937_3e-1,
        1.818_357_216_161_805e-1,
        2.222_219_843_214_978_4e-1,
        2.857_142_874_366_239e-1,
        3.999_999_999_940_942e-1,
        6.666_666_666_666_735e-1,
    ];
    let mut result = [0.0; ELEMENTS_PER_GROUP];
    for lane in 0..ELEMENTS_PER_GROUP {
        let p = p[lane];
        let u = 1.0 - p;
        let error = ((1.0 - u) - p) / u;
        // The sum of k and this offset is positive, because u is not above 1.
        let bits = u.to_bits().wrapping_add(OFFSET << 52);
        let offset_k = bits.wrapping_sub(SQRT_HALF_BITS) >> 52;
        let k = f64::from_bits(SHIFT.to_bits() + offset_k) - (SHIFT + OFFSET as f64);
        let f = f64::from_bits(bits.wrapping_sub(offset_k << 52)) - 1.0;
        let s = f / (2.0 + f);
        let square = s * s;
        let mut sum = SERIES[0];
        for coefficient in &SERIES[1..] {
            sum = sum * square + coefficient;
        }
        let half_square = 0.5 * f * f;
        let small = s * (half_square + square * sum) + (k * LN_2_LOW + error);
        let value = -(k * LN_2_HIGH - ((half_square - small) - f));
        let value = if p >= 1.0 { f64::INFINITY } else { value };
        result[lane] = if p > 0.0 { value } else { 0.0 };
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minus_ln_1m_agrees_with_the_standard_library() {
        let mut p = 1e-300;
        while p < 1.0 {
            for p in [p, 1.0 - p] {
                let value = minus_ln_1m(&[p; ELEMENTS_PER_GROUP])[0];
                let exact = -(-p).ln_1p();
                assert!(
                    value.to_bits() == exact.to_bits()
                        || (value - exact).abs() <= 4.0 * f64::EPSILON * exact,
                    "{p}: {value} instead of {exact}"
                );
            }
            p *= 1.0 + 1e-2;
        }
        for (p, expected) in [
            (f64::NAN, 0.0),
            (-1.0, 0.0),
            (0.0, 0.0),
            (2.0, f64::INFINITY),
        ] {
            let value = minus_ln_1m(&[p; ELEMENTS_PER_GROUP])[0];
            assert!(value.to_bits() == f64::to_bits(expected), "{p}: {value}");
        }
    }

    #[test]
    fn exp_m1_agrees_with_the_standard_library() {
        let mut x = 1e-150;
        while x < 709.0 {
            let value = exp_m1(&[x; ELEMENTS_PER_GROUP])[0];
            let exact = x.exp_m1();
            assert!(
                (value - exact).abs() <= 4.0 * f64::EPSILON * exact,
                "{x}: {value} instead of {exact}"
            );
            x *= 1.0 + 1e-3;
        }
        assert!(exp_m1(&[1e4; ELEMENTS_PER_GROUP])[0] > 1e307);
    }
}
