//! The values of splines with few knots by AVX2, equations (8) and (10).
//!
//! A pair of registers holds a coefficient of up to sixteen polynomials. The instruction `vpermps`
//! looks up eight coefficients in each register, and `vblendvps` selects between the two.

use std::arch::x86_64::_CMP_GE_OQ;

use pulp::x86::V3;
use pulp::{Simd, WithSimd, cast, f32x8};

use super::registers::SmallSpline;

/// The number of `f32` in a register.
const LANES: usize = 8;

/// At this magnitude, the last bit of the mantissa is worth 1, as in `Real::nearest`.
const UNIT_ULP: f32 = 8_388_608.0;

/// The evaluation of a spline on a plane, in place. The results agree with those of
/// [`super::evaluate::Spline::value`] up to rounding.
pub(super) struct RegisterPairValues<'a> {
    pub simd: V3,
    pub small: &'a SmallSpline,
    pub plane: &'a mut [f32],
}

impl WithSimd for RegisterPairValues<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // The loop does not change a local copy, so its values stay in registers.
        let small = *self.small;
        let (groups, rest) = self.plane.as_chunks_mut::<LANES>();
        for group in groups {
            *group = values(self.simd, &small, *group);
        }
        if !rest.is_empty() {
            let mut group = [0.0; LANES];
            group[..rest.len()].copy_from_slice(rest);
            group = values(self.simd, &small, group);
            rest.copy_from_slice(&group[..rest.len()]);
        }
    }
}

/// Return φ(z) of eight values.
// The functions are inlined because a call would pass registers through memory.
#[inline(always)]
fn values(simd: V3, small: &SmallSpline, z: [f32; LANES]) -> [f32; LANES] {
    let start = simd.splat_f32x8(small.start);
    let inverse_spacing = simd.splat_f32x8(small.inverse_spacing);
    let position = simd.mul_f32x8(simd.sub_f32x8(cast(z), start), inverse_spacing);
    let position = clamp(simd, position, 0.0, small.intervals);
    let floor = simd.avx._mm256_floor_ps(cast(position));
    let last = simd.splat_f32x8(small.intervals - 1.0);
    let knot: f32x8 = cast(simd.avx._mm256_min_ps(floor, cast(last)));
    let f = simd.sub_f32x8(position, knot);
    let value = look_up(simd, small, 3, knot);
    let value = simd.mul_add_f32x8(value, f, look_up(simd, small, 2, knot));
    let value = simd.mul_add_f32x8(value, f, look_up(simd, small, 1, knot));
    let value = simd.mul_add_f32x8(value, f, look_up(simd, small, 0, knot));
    let (low, high) = small.bounds;
    cast(clamp(simd, value, low, high))
}

/// Return the coefficients of a power for eight intervals.
#[inline(always)]
fn look_up(simd: V3, small: &SmallSpline, power: usize, knot: f32x8) -> f32x8 {
    let (halves, _) = small.powers[power].as_chunks::<LANES>();
    // `vpermps` reads the three low bits of an index, which contain the interval modulo 8.
    let index = cast(simd.add_f32x8(knot, simd.splat_f32x8(UNIT_ULP)));
    let [low, high] =
        [halves[0], halves[1]].map(|half| simd.avx2._mm256_permutevar8x32_ps(cast(half), index));
    let eight = simd.splat_f32x8(LANES as f32);
    let is_high = simd
        .avx
        ._mm256_cmp_ps::<_CMP_GE_OQ>(cast(knot), cast(eight));
    cast(simd.avx._mm256_blendv_ps(low, high, is_high))
}

/// Return x limited to \[low, high\], and `low` for NaN.
#[inline(always)]
fn clamp(simd: V3, x: f32x8, low: f32, high: f32) -> f32x8 {
    let (low, high) = (simd.splat_f32x8(low), simd.splat_f32x8(high));
    let x = simd.avx._mm256_max_ps(cast(x), cast(low));
    cast(simd.avx._mm256_min_ps(x, cast(high)))
}
