//! Splines of few knots with AVX-512: their tables lie in registers, where a permutation looks sixteen numbers up at a time.

use pulp::x86::V4;
use pulp::{Simd, WithSimd, cast, f32x16};

/// Knot intervals that a register tells apart.
pub(crate) const INTERVALS: usize = 16;

/// φ of many in place, in the same operations as everywhere else.
pub(crate) struct Short<'a> {
    pub simd: V4,
    /// The cubic of each interval, power by power.
    pub powers: [[f32; INTERVALS]; 4],
    pub intervals: f32,
    pub start: f32,
    pub inverse_spacing: f32,
    pub hull: (f32, f32),
    pub plane: &'a mut [f32],
}

impl WithSimd for Short<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        let (groups, rest) = std::mem::take(&mut self.plane).as_chunks_mut::<INTERVALS>();
        for group in groups {
            *group = self.bent(*group);
        }
        let mut group = [0.0; INTERVALS];
        group[..rest.len()].copy_from_slice(rest);
        group = self.bent(group);
        rest.copy_from_slice(&group[..rest.len()]);
    }
}

impl Short<'_> {
    /// Everything is inlined into code for these instructions, or it would be slow.
    #[inline(always)]
    fn bent(&self, z: [f32; INTERVALS]) -> [f32; INTERVALS] {
        let simd = self.simd;
        // At this size the last bit of a number is worth 1.
        let ones = simd.splat_f32x16(8_388_608.0);
        let start = simd.splat_f32x16(self.start);
        let inverse = simd.splat_f32x16(self.inverse_spacing);
        let place = simd.mul_f32x16(simd.sub_f32x16(cast(z), start), inverse);
        let place = self.clamped(place, 0.0, self.intervals);
        let nearest = simd.sub_f32x16(place, simd.splat_f32x16(0.5));
        let shifted = simd.add_f32x16(self.clamped(nearest, 0.0, self.intervals - 1.0), ones);
        let f = simd.sub_f32x16(place, simd.sub_f32x16(shifted, ones));
        let value = simd.mul_f32x16(self.table(3, shifted), f);
        let value = simd.mul_f32x16(simd.add_f32x16(value, self.table(2, shifted)), f);
        let value = simd.mul_f32x16(simd.add_f32x16(value, self.table(1, shifted)), f);
        let value = simd.add_f32x16(value, self.table(0, shifted));
        cast(self.clamped(value, self.hull.0, self.hull.1))
    }

    /// `low` for NaN.
    #[inline(always)]
    fn clamped(&self, x: f32x16, low: f32, high: f32) -> f32x16 {
        let Self { simd, .. } = self;
        let (low, high) = (simd.splat_f32x16(low), simd.splat_f32x16(high));
        let x = simd.avx512f._mm512_max_ps(cast(x), cast(low));
        cast(simd.avx512f._mm512_min_ps(x, cast(high)))
    }

    /// The entries of which the last bits of `index` are the numbers.
    #[inline(always)]
    fn table(&self, power: usize, index: f32x16) -> f32x16 {
        let table: f32x16 = cast(self.powers[power]);
        cast(
            self.simd
                .avx512f
                ._mm512_permutexvar_ps(cast(index), cast(table)),
        )
    }
}

#[cfg(test)]
mod tests {
    use crate::network::Spline;
    use crate::network::spline::evaluate::clamp;

    #[test]
    fn a_table_in_registers_gives_the_same_bits() {
        for number in [4, 5, 13, 19] {
            let coefficients: Vec<f32> =
                (0..number).map(|k| ((k * k) as f32 * 0.7).sin()).collect();
            let spline = Spline::new(&coefficients, -1.5, 0.25);
            for length in [1, 15, 16, 100] {
                let mut plane: Vec<f32> = (0..length).map(|k| k as f32 * 0.11 - 3.0).collect();
                plane[0] = f32::NAN;
                let one_by_one: Vec<f32> = plane.iter().map(|&z| spline.value(z)).collect();
                spline.apply(&mut plane);
                assert_eq!(plane, one_by_one);
            }
        }
        assert!(clamp(f32::NAN, 1.0, 2.0).eq(&1.0));
    }
}
