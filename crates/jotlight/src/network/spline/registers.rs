//! Splines with few knots by AVX-512: values, equations (8) and (10), and gradients, equations (14)
//! to (19).
//!
//! Registers hold the coefficients of the polynomials. The instruction `vpermps` looks up sixteen
//! coefficients at a time.

use std::arch::x86_64::{_CMP_EQ_OQ, _MM_FROUND_NO_EXC, _MM_FROUND_TO_NEG_INF};

use pulp::x86::V4;
use pulp::{Simd, WithSimd, cast, f32x16};

use crate::numbers::Real;

/// The maximum number of knot intervals, which is the number of `f32` in a register.
pub(super) const MAX_INTERVALS: usize = LANES;

/// A spline with few knots, as `f32`.
#[derive(Clone, Copy, Debug)]
pub(super) struct SmallSpline {
    /// The coefficients of the polynomial of each knot interval, power by power.
    pub powers: [[f32; MAX_INTERVALS]; 4],
    pub intervals: f32,
    pub start: f32,
    pub inverse_spacing: f32,
    /// The minimum and the maximum of the spline coefficients.
    pub bounds: (f32, f32),
}

/// A spline whose polynomials are in registers.
#[derive(Clone, Copy)]
pub(super) struct RegisterSpline<'a> {
    pub simd: V4,
    pub small: &'a SmallSpline,
}

/// The evaluation of a spline on a plane, in place. The results agree with those of
/// [`super::evaluate::Spline::value`] up to rounding.
pub(super) struct RegisterValues<'a> {
    pub spline: RegisterSpline<'a>,
    pub plane: &'a mut [f32],
}

/// Sums Σ gradient · (1, f, f², f³) over the pixels in each knot interval, in [`LANES`] parts.
pub(super) type IntervalSums = [[[f32; LANES]; 4]; MAX_INTERVALS];

/// The number of `f32` in a register.
pub(super) const LANES: usize = 16;

/// The backpropagation through a spline on a plane. It replaces the gradients with respect to φ(z)
/// with those with respect to z, and adds to the sums.
pub(super) struct RegisterGradients<'a, F> {
    pub spline: RegisterSpline<'a>,
    /// The values z.
    pub inputs: &'a [F],
    pub gradient: &'a mut [f32],
    pub sums: &'a mut IntervalSums,
}

/// The position of sixteen values in the knot intervals.
struct Location {
    /// The distance from the first knot, in knot intervals, before it is clamped to the domain.
    unclamped: f32x16,
    position: f32x16,
    /// The low bits contain the knot interval.
    index: f32x16,
    /// The fraction of the knot interval that lies below the value.
    f: f32x16,
}

/// The mode of rounding to the next smaller integer.
const FLOOR: i32 = _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC;

/// At this magnitude, the last bit of the mantissa is worth 1, as in `Real::nearest`.
const UNIT_ULP: f32 = 8_388_608.0;

impl WithSimd for RegisterValues<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        // The loop does not change a local copy, so its values stay in registers.
        let small = *self.spline.small;
        let spline = RegisterSpline {
            small: &small,
            ..self.spline
        };
        let (groups, rest) = self.plane.as_chunks_mut::<LANES>();
        for group in groups {
            *group = spline.values(*group);
        }
        if !rest.is_empty() {
            let mut group = [0.0; LANES];
            group[..rest.len()].copy_from_slice(rest);
            group = spline.values(group);
            rest.copy_from_slice(&group[..rest.len()]);
        }
    }
}

impl<F: Real> WithSimd for RegisterGradients<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        let gradient = std::mem::take(&mut self.gradient);
        let groups = self.inputs.chunks(LANES).zip(gradient.chunks_mut(LANES));
        for (inputs, gradient) in groups {
            // A gradient of 0 pads the last group.
            let (mut z, mut outer) = ([0.0; LANES], [0.0; LANES]);
            for (z, &input) in z.iter_mut().zip(inputs) {
                *z = input.as_f64() as f32;
            }
            outer[..gradient.len()].copy_from_slice(gradient);
            outer = self.pull_back(z, outer);
            gradient.copy_from_slice(&outer[..gradient.len()]);
        }
    }
}

impl<F> RegisterGradients<'_, F> {
    /// Return the gradient with respect to sixteen values, and add their terms to the sums.
    #[inline(always)]
    fn pull_back(&mut self, z: [f32; LANES], gradient: [f32; LANES]) -> [f32; LANES] {
        let spline = &self.spline;
        let simd = spline.simd;
        let location = spline.locate(z);
        let (index, f) = (location.index, location.f);
        // The derivative of a + b·f + c·f² + d·f³.
        let (two, three) = (simd.splat_f32x16(2.0), simd.splat_f32x16(3.0));
        let slope = simd.mul_f32x16(simd.mul_f32x16(three, spline.look_up(3, index)), f);
        let linear = simd.mul_f32x16(two, spline.look_up(2, index));
        let slope = simd.mul_f32x16(simd.add_f32x16(slope, linear), f);
        let slope = simd.add_f32x16(slope, spline.look_up(1, index));
        let slope = simd.mul_f32x16(slope, simd.splat_f32x16(spline.small.inverse_spacing));
        let gradient: f32x16 = cast(gradient);
        let linear = simd.mul_f32x16(gradient, f);
        let squared = simd.mul_f32x16(linear, f);
        let powers = [gradient, linear, squared, simd.mul_f32x16(squared, f)];
        let avx512f = simd.avx512f;
        let mut interval = avx512f._mm512_set1_epi32(UNIT_ULP.to_bits().cast_signed());
        let one = avx512f._mm512_set1_epi32(1);
        for sums in self.sums.iter_mut().take(spline.small.intervals as usize) {
            let is_inside = avx512f._mm512_cmpeq_epi32_mask(cast(index), interval);
            interval = avx512f._mm512_add_epi32(interval, one);
            for (sum, power) in sums.iter_mut().zip(powers) {
                let old = cast(*sum);
                *sum = cast(avx512f._mm512_mask_add_ps(old, is_inside, old, cast(power)));
            }
        }
        // Outside the domain, φ is constant.
        let is_inside = avx512f
            ._mm512_cmp_ps_mask::<_CMP_EQ_OQ>(cast(location.unclamped), cast(location.position));
        cast(avx512f._mm512_maskz_mul_ps(is_inside, cast(gradient), cast(slope)))
    }
}

impl RegisterSpline<'_> {
    /// Return φ(z) of sixteen values.
    // The methods are inlined because a call would pass registers through memory.
    #[inline(always)]
    fn values(self, z: [f32; LANES]) -> [f32; LANES] {
        let (simd, (low, high)) = (self.simd, self.small.bounds);
        let Location { index, f, .. } = self.locate(z);
        let value = simd.mul_add_f32x16(self.look_up(3, index), f, self.look_up(2, index));
        let value = simd.mul_add_f32x16(value, f, self.look_up(1, index));
        let value = simd.mul_add_f32x16(value, f, self.look_up(0, index));
        cast(self.clamp(value, low, high))
    }

    #[inline(always)]
    fn locate(self, z: [f32; LANES]) -> Location {
        let simd = self.simd;
        let unit_ulp = simd.splat_f32x16(UNIT_ULP);
        let start = simd.splat_f32x16(self.small.start);
        let inverse_spacing = simd.splat_f32x16(self.small.inverse_spacing);
        let unclamped = simd.mul_f32x16(simd.sub_f32x16(cast(z), start), inverse_spacing);
        let position = self.clamp(unclamped, 0.0, self.small.intervals);
        let last = simd.splat_f32x16(self.small.intervals - 1.0);
        let floor = simd.avx512f._mm512_roundscale_ps::<FLOOR>(cast(position));
        let knot: f32x16 = cast(simd.avx512f._mm512_min_ps(floor, cast(last)));
        Location {
            unclamped,
            position,
            index: simd.add_f32x16(knot, unit_ulp),
            f: simd.sub_f32x16(position, knot),
        }
    }

    /// Return x limited to \[low, high\], and `low` for NaN.
    #[inline(always)]
    fn clamp(self, x: f32x16, low: f32, high: f32) -> f32x16 {
        let Self { simd, .. } = self;
        let (low, high) = (simd.splat_f32x16(low), simd.splat_f32x16(high));
        let x = simd.avx512f._mm512_max_ps(cast(x), cast(low));
        cast(simd.avx512f._mm512_min_ps(x, cast(high)))
    }

    /// Return the coefficients of a power for sixteen intervals. The low bits of `index` contain
    /// the intervals.
    #[inline(always)]
    fn look_up(self, power: usize, index: f32x16) -> f32x16 {
        let table: f32x16 = cast(self.small.powers[power]);
        let avx512f = self.simd.avx512f;
        cast(avx512f._mm512_permutexvar_ps(cast(index), cast(table)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate::{Spline, clamp};

    #[test]
    fn tables_in_registers_lead_to_the_same_values() {
        for knots in [4, 5, 13, 19] {
            let coefficients: Vec<f32> = (0..knots).map(|k| ((k * k) as f32 * 0.7).sin()).collect();
            let spline = Spline::new(&coefficients, -1.5, 0.25);
            for length in [1, 15, 16, 100] {
                let mut plane: Vec<f32> = (0..length).map(|k| k as f32 * 0.11 - 3.0).collect();
                plane[0] = f32::NAN;
                let expected: Vec<f32> = plane.iter().map(|&z| spline.value(z)).collect();
                spline.apply(&mut plane);
                for (value, expected) in plane.iter().zip(expected) {
                    assert!(
                        (value - expected).abs() <= 1e-6,
                        "{value} instead of {expected}"
                    );
                }
            }
        }
        assert!(clamp(f32::NAN, 1.0, 2.0).eq(&1.0));
    }
}
