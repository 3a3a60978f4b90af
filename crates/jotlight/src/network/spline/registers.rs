//! Evaluation of splines with few knots by AVX-512, equations (8) and (10).
//!
//! Registers hold the coefficients of the polynomials. The instruction `vpermps` looks up sixteen
//! coefficients at a time.

use pulp::x86::V4;
use pulp::{Simd, WithSimd, cast, f32x16};

/// The maximum number of knot intervals, which is the number of `f32` in a register.
pub(super) const MAX_INTERVALS: usize = 16;

/// The evaluation of a spline on a plane, in place. It performs the same operations as
/// [`super::evaluate::Spline::value`], so the results are identical.
pub(super) struct RegisterTable<'a> {
    pub simd: V4,
    /// The coefficients of the polynomial of each knot interval, power by power.
    pub powers: [[f32; MAX_INTERVALS]; 4],
    pub intervals: f32,
    pub start: f32,
    pub inverse_spacing: f32,
    pub bounds: (f32, f32),
    pub plane: &'a mut [f32],
}

impl WithSimd for RegisterTable<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        let (groups, rest) = std::mem::take(&mut self.plane).as_chunks_mut::<MAX_INTERVALS>();
        for group in groups {
            *group = self.values(*group);
        }
        let mut group = [0.0; MAX_INTERVALS];
        group[..rest.len()].copy_from_slice(rest);
        group = self.values(group);
        rest.copy_from_slice(&group[..rest.len()]);
    }
}

impl RegisterTable<'_> {
    /// Return φ(z) of sixteen values.
    // The methods are inlined because a call would pass registers through memory.
    #[inline(always)]
    fn values(&self, z: [f32; MAX_INTERVALS]) -> [f32; MAX_INTERVALS] {
        let simd = self.simd;
        // At this magnitude, the last bit of the mantissa is worth 1, as in `Real::nearest`.
        let unit_ulp = simd.splat_f32x16(8_388_608.0);
        let start = simd.splat_f32x16(self.start);
        let inverse_spacing = simd.splat_f32x16(self.inverse_spacing);
        let position = simd.mul_f32x16(simd.sub_f32x16(cast(z), start), inverse_spacing);
        let position = self.clamp(position, 0.0, self.intervals);
        let center = simd.sub_f32x16(position, simd.splat_f32x16(0.5));
        let index = simd.add_f32x16(self.clamp(center, 0.0, self.intervals - 1.0), unit_ulp);
        let f = simd.sub_f32x16(position, simd.sub_f32x16(index, unit_ulp));
        let value = simd.mul_f32x16(self.look_up(3, index), f);
        let value = simd.mul_f32x16(simd.add_f32x16(value, self.look_up(2, index)), f);
        let value = simd.mul_f32x16(simd.add_f32x16(value, self.look_up(1, index)), f);
        let value = simd.add_f32x16(value, self.look_up(0, index));
        cast(self.clamp(value, self.bounds.0, self.bounds.1))
    }

    /// Return x limited to \[low, high\], and `low` for NaN.
    #[inline(always)]
    fn clamp(&self, x: f32x16, low: f32, high: f32) -> f32x16 {
        let Self { simd, .. } = self;
        let (low, high) = (simd.splat_f32x16(low), simd.splat_f32x16(high));
        let x = simd.avx512f._mm512_max_ps(cast(x), cast(low));
        cast(simd.avx512f._mm512_min_ps(x, cast(high)))
    }

    /// Return the coefficients of a power for sixteen intervals. The low bits of `index` contain
    /// the intervals.
    #[inline(always)]
    fn look_up(&self, power: usize, index: f32x16) -> f32x16 {
        let table: f32x16 = cast(self.powers[power]);
        let avx512f = self.simd.avx512f;
        cast(avx512f._mm512_permutexvar_ps(cast(index), cast(table)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate::{Spline, clamp};

    #[test]
    fn tables_in_registers_lead_to_the_same_bits() {
        for knots in [4, 5, 13, 19] {
            let coefficients: Vec<f32> = (0..knots).map(|k| ((k * k) as f32 * 0.7).sin()).collect();
            let spline = Spline::new(&coefficients, -1.5, 0.25);
            for length in [1, 15, 16, 100] {
                let mut plane: Vec<f32> = (0..length).map(|k| k as f32 * 0.11 - 3.0).collect();
                plane[0] = f32::NAN;
                let expected: Vec<f32> = plane.iter().map(|&z| spline.value(z)).collect();
                spline.apply(&mut plane);
                assert_eq!(plane, expected);
            }
        }
        assert!(clamp(f32::NAN, 1.0, 2.0).eq(&1.0));
    }
}
