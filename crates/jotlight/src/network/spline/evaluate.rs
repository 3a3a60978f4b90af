//! The value of a cubic B-spline, equations (8) and (10), and its derivatives, equations (17) and
//! (19).

#[cfg(target_arch = "x86_64")]
use super::register_pairs::RegisterPairValues;
#[cfg(target_arch = "x86_64")]
use super::registers::{MAX_INTERVALS, RegisterSpline, RegisterValues, SmallSpline};
#[cfg(target_arch = "x86_64")]
use crate::cpu::{self, WithSimd};
use crate::cpu::{Simd, levels};
use crate::interrupt;
use crate::numbers::Real;

/// φ(z) = Σ_k w_k β3((z − start)/Δ − (k − 1)): equations (8) and (10).
///
/// Its domain is \[start, start + (N_w − 3) Δ\]. Outside the domain, φ is constant.
///
/// `Differs from the paper:` the knots begin at `start` and not at 0, so that all N_w basis
/// functions overlap the range of the input.
#[derive(Clone, Debug)]
pub struct Spline<F> {
    /// The polynomial of each knot interval: its coefficients of 1, f, f², and f³, where f is the
    /// fraction of the interval that lies below z.
    pub(super) cubics: Vec<[F; 4]>,
    /// The coefficients of the first [`TABLE`] polynomials, power by power.
    powers: Box<[[F; TABLE]; 4]>,
    start: F,
    inverse_spacing: F,
    /// The minimum and the maximum of the spline coefficients. φ lies between them.
    bounds: (F, F),
    /// The spline for registers, if it has few knots.
    #[cfg(target_arch = "x86_64")]
    small: Option<Box<SmallSpline>>,
}

/// The number of values after which a long loop asks whether the call is interrupted. It is a
/// multiple of the groups of the vectorized loops.
const VALUES_PER_QUESTION: usize = 1 << 16;

/// The number of pixels that the vectorized loops process together.
const GROUP: usize = 64;

/// The length of the table of polynomials. An index of one byte needs no bounds check.
pub(super) const TABLE: usize = 256;

impl<F: Real> Spline<F> {
    pub(crate) fn new(coefficients: &[F], start: F, spacing: F) -> Self {
        let bounds = coefficients
            .iter()
            .fold((F::infinity(), F::neg_infinity()), |(low, high), &w| {
                (low.min(w), high.max(w))
            });
        let cubics: Vec<_> = coefficients.windows(4).map(cubic).collect();
        let mut powers = Box::new([[F::zero(); TABLE]; 4]);
        for (interval, cubic) in cubics.iter().take(TABLE).enumerate() {
            for (table, &factor) in powers.iter_mut().zip(cubic) {
                table[interval] = factor;
            }
        }
        Self {
            #[cfg(target_arch = "x86_64")]
            small: (cubics.len() <= MAX_INTERVALS).then(|| {
                let to_f32 = |x: F| x.as_f64() as f32;
                Box::new(SmallSpline {
                    powers: powers
                        .each_ref()
                        .map(|table| std::array::from_fn(|interval| to_f32(table[interval]))),
                    intervals: cubics.len() as f32,
                    start: to_f32(start),
                    inverse_spacing: to_f32(F::one() / spacing),
                    bounds: (to_f32(bounds.0), to_f32(bounds.1)),
                })
            }),
            cubics,
            powers,
            start,
            inverse_spacing: F::one() / spacing,
            bounds,
        }
    }

    /// Return the number N_w of coefficients.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cubics.len() + 3
    }

    /// Return false: a spline has at least four coefficients.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Return φ(z): equations (8) and (10).
    ///
    /// The value is clamped to the range of the coefficients, so that rounding cannot exceed it.
    #[must_use]
    #[inline(always)]
    pub fn value(&self, z: F) -> F {
        let (interval, f) = self.locate(z);
        self.bounded(polynomial(self.cubics[interval as usize], f))
    }

    /// Return φ'(z), which is 0 where φ is constant.
    #[must_use]
    #[inline(always)]
    pub fn slope(&self, z: F) -> F {
        let (interval, f) = self.locate(z);
        self.slope_in(interval as usize, f, z)
    }

    /// Return φ'(z), where the fraction `f` of the knot interval of z lies below z.
    #[inline(always)]
    pub(super) fn slope_in(&self, interval: usize, f: F, z: F) -> F {
        let [_, b, c, d] = self.cubics[interval];
        let (two, three) = (F::from_f64(2.0), F::from_f64(3.0));
        let slope = ((three * d * f + two * c) * f + b) * self.inverse_spacing;
        let position = (z - self.start) * self.inverse_spacing;
        let inside = position >= F::zero() && position <= F::from_index(self.cubics.len());
        if inside { slope } else { F::zero() }
    }

    /// Return the derivatives dφ(z)/dw_k with respect to the coefficients: equations (17) and (19).
    ///
    /// Only four consecutive derivatives may differ from 0. The result is the index k of the first
    /// of them, and the four values.
    #[must_use]
    #[inline(always)]
    pub fn weights(&self, z: F) -> (usize, [F; 4]) {
        let (interval, f) = self.locate(z);
        let f = f.as_f64();
        let powers = [1.0, f, f * f, f * f * f];
        let weights = BASIS.map(|basis| F::from_f64(dot(basis, powers)));
        (interval as usize, weights)
    }

    /// Replace each value z of a plane with φ(z).
    pub fn apply(&self, plane: &mut [F]) {
        for part in plane.chunks_mut(VALUES_PER_QUESTION) {
            if interrupt::is_requested() {
                return;
            }
            self.apply_to_part(part);
        }
    }

    /// Replace each value z with φ(z), in code that is compiled for an instruction set.
    #[inline(always)]
    pub(crate) fn apply_with<S: Simd>(&self, simd: S, values: &mut [F]) {
        #[cfg(target_arch = "x86_64")]
        if let Some(work) = self.values_in_registers(values) {
            return work.with_simd(simd);
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(work) = self.values_in_register_pairs(values) {
            return work.with_simd(simd);
        }
        let _ = simd;
        self.apply_inlined(values);
    }

    fn apply_to_part(&self, plane: &mut [F]) {
        #[cfg(target_arch = "x86_64")]
        if let Some(work) = self.values_in_registers(plane) {
            return cpu::run(work);
        }
        #[cfg(target_arch = "x86_64")]
        if let Some(work) = self.values_in_register_pairs(plane) {
            return cpu::run(work);
        }
        apply(self, plane);
    }

    /// Return the evaluation with the spline in registers, if that is possible.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn values_in_registers<'a>(&'a self, plane: &'a mut [F]) -> Option<RegisterValues<'a>> {
        Some(RegisterValues {
            spline: self.in_registers()?,
            plane: F::as_f32_slice(plane)?,
        })
    }

    /// Return the evaluation with the spline in pairs of registers, if that is possible.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn values_in_register_pairs<'a>(
        &'a self,
        plane: &'a mut [F],
    ) -> Option<RegisterPairValues<'a>> {
        Some(RegisterPairValues {
            simd: cpu::v3()?,
            small: self.small.as_deref()?,
            plane: F::as_f32_slice(plane)?,
        })
    }

    /// Return the spline in registers, if it has few knots and the processor has AVX-512.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(super) fn in_registers(&self) -> Option<RegisterSpline<'_>> {
        Some(RegisterSpline {
            small: self.small.as_deref()?,
            simd: cpu::v4()?,
        })
    }

    #[inline(always)]
    fn apply_inlined(&self, plane: &mut [F]) {
        if self.cubics.len() > TABLE {
            for z in plane {
                *z = self.value(*z);
            }
            return;
        }
        let (groups, rest) = plane.as_chunks_mut::<GROUP>();
        for group in groups {
            self.apply_to_group(group);
        }
        // The remainder is padded to a group. The same loop then evaluates all pixels, so the
        // value of a pixel does not depend on its position in the plane.
        if !rest.is_empty() {
            let mut group = [F::zero(); GROUP];
            group[..rest.len()].copy_from_slice(rest);
            self.apply_to_group(&mut group);
            rest.copy_from_slice(&group[..rest.len()]);
        }
    }

    /// Replace each value z of a group with φ(z).
    ///
    /// The compiler vectorizes each of the two loops, but would not vectorize a single loop.
    #[inline(always)]
    fn apply_to_group(&self, group: &mut [F; GROUP]) {
        let (mut intervals, mut fractions) = ([0; GROUP], [F::zero(); GROUP]);
        for pixel in 0..GROUP {
            (intervals[pixel], fractions[pixel]) = self.locate(group[pixel]);
        }
        let [a, b, c, d] = &*self.powers;
        for pixel in 0..GROUP {
            let interval = usize::from(intervals[pixel] as u8);
            let cubic = [a[interval], b[interval], c[interval], d[interval]];
            group[pixel] = self.bounded(polynomial(cubic, fractions[pixel]));
        }
    }

    /// Return the knot interval that contains z, and the fraction of the interval that lies below
    /// z.
    ///
    /// If z is a knot, the function may return either adjacent interval. Both lead to the same
    /// results, because φ and φ' are continuous.
    #[inline(always)]
    pub(super) fn locate(&self, z: F) -> (u32, F) {
        let intervals = F::from_index(self.cubics.len());
        let half = F::from_f64(0.5);
        let position = (z - self.start) * self.inverse_spacing;
        let position = clamp(position, F::zero(), intervals);
        let (first, index) = clamp(position - half, F::zero(), intervals - F::one()).nearest();
        (index, position - first)
    }

    #[inline(always)]
    fn bounded(&self, value: F) -> F {
        clamp(value, self.bounds.0, self.bounds.1)
    }
}

levels! {
    fn apply[F: Real](spline: &Spline<F>, plane: &mut [F]) = Spline::apply_inlined;
}

/// Return x limited to \[low, high\], and `low` for NaN.
#[inline(always)]
pub(super) fn clamp<F: Real>(x: F, low: F, high: F) -> F {
    let x = if x > low { x } else { low };
    if x < high { x } else { high }
}

/// Return a + b·f + c·f² + d·f³.
#[inline(always)]
fn polynomial<F: Real>([a, b, c, d]: [F; 4], f: F) -> F {
    ((d * f + c) * f + b) * f + a
}

/// Return the polynomial of a knot interval, in powers of f, from its four spline coefficients.
fn cubic<F: Real>(w: &[F]) -> [F; 4] {
    std::array::from_fn(|power| {
        let terms = w
            .iter()
            .zip(BASIS)
            .map(|(w, basis)| w.as_f64() * basis[power]);
        F::from_f64(terms.sum())
    })
}

/// The four cubic B-splines that are not 0 in a knot interval, as coefficients of 1, f, f², and f³.
/// The fraction f of the interval lies in \[0, 1\].
pub(in crate::network) const BASIS: [[f64; 4]; 4] = [
    [1.0 / 6.0, -0.5, 0.5, -1.0 / 6.0],
    [4.0 / 6.0, 0.0, -1.0, 0.5],
    [1.0 / 6.0, 0.5, 0.5, -0.5],
    [0.0, 0.0, 0.0, 1.0 / 6.0],
];

pub(super) fn dot(a: [f64; 4], b: [f64; 4]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_coefficients_make_a_constant() {
        let spline = Spline::new(&[2.0f32; 6], -1.0, 0.5);
        for z in [-9.0, -1.0, -0.3, 0.0, 0.5, 9.0] {
            assert!((spline.value(z) - 2.0).abs() < 1e-6);
            assert!(spline.slope(z).abs() < 1e-6);
        }
    }

    #[test]
    fn equally_spaced_coefficients_make_a_line() {
        let spline = Spline::new(&[-1.0, 0.0, 1.0, 2.0, 3.0], 10.0, 2.0);
        for z in [10.0f64, 10.5, 12.0, 13.7, 14.0] {
            assert!((spline.value(z) - (z - 10.0) / 2.0).abs() < 1e-12);
            assert!((spline.slope(z) - 0.5).abs() < 1e-12);
        }
    }

    #[test]
    fn slopes_and_weights_are_the_derivatives() {
        let coefficients = [0.3, -1.2, 2.0, 0.7, 1.1, -0.4];
        let spline = Spline::new(&coefficients, -1.0, 0.5);
        let step = 1e-6;
        for z in [-0.97f64, -0.6, -0.1, 0.2, 0.49] {
            let difference = (spline.value(z + step) - spline.value(z - step)) / (2.0 * step);
            assert!((spline.slope(z) - difference).abs() < 1e-8);

            let (first, weights) = spline.weights(z);
            for k in 0..coefficients.len() {
                let mut changed = coefficients;
                changed[k] += step;
                let difference = Spline::new(&changed, -1.0, 0.5).value(z) - spline.value(z);
                let weight = k.checked_sub(first).and_then(|k| weights.get(k));
                assert!((weight.unwrap_or(&0.0) - difference / step).abs() < 1e-8);
            }
        }
    }
}
