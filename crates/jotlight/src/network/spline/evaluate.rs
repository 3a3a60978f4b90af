//! The pointwise nonlinearity: a cubic B-spline on even knots.

#[cfg(target_arch = "x86_64")]
use crate::cpu;
use crate::cpu::levels;
#[cfg(target_arch = "x86_64")]
use crate::network::spline::registers::{INTERVALS, Short};
use crate::numbers::Real;

/// φ(z) = Σ_k w_k β3((z − start)/Δ − (k − 1)): equations (8) and (10), on \[start, start + (N_w − 3) Δ\]; constant outside of it.
///
/// `Differs from the paper:` the knots begin at `start` and not at 0, so that all N_w functions lie over the range of the input.
#[derive(Clone, Debug)]
pub struct Spline<F> {
    /// The cubic of each knot interval, in powers of the distance past its first knot.
    cubics: Vec<[F; 4]>,
    /// The same, power by power, as far as there is room.
    powers: Box<[[F; TABLE]; 4]>,
    start: F,
    inverse_spacing: F,
    hull: (F, F),
}

/// Pixels that are worked on at a time.
const GROUP: usize = 64;

/// Knot intervals that a byte tells apart: of a table with so many, indices need not be checked.
const TABLE: usize = 256;

impl<F: Real> Spline<F> {
    pub(crate) fn new(coefficients: &[F], start: F, spacing: F) -> Self {
        let hull = coefficients
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
            cubics,
            powers,
            start,
            inverse_spacing: F::one() / spacing,
            hull,
        }
    }

    /// N_w.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cubics.len() + 3
    }

    /// Never: a spline has at least four coefficients.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        false
    }

    /// φ(z), never outside of the coefficients' hull, not even by rounding.
    #[must_use]
    #[inline(always)]
    pub fn value(&self, z: F) -> F {
        let (first, f) = self.place(z);
        let [a, b, c, d] = self.cubics[first as usize];
        clamp(((d * f + c) * f + b) * f + a, self.hull.0, self.hull.1)
    }

    /// φ'(z), 0 where φ is constant.
    #[must_use]
    #[inline(always)]
    pub fn slope(&self, z: F) -> F {
        let (first, f) = self.place(z);
        self.slope_at(z, first as usize, f)
    }

    #[inline(always)]
    fn slope_at(&self, z: F, first: usize, f: F) -> F {
        let [_, b, c, d] = self.cubics[first];
        let (two, three) = (F::from_f64(2.0), F::from_f64(3.0));
        let slope = ((three * d * f + two * c) * f + b) * self.inverse_spacing;
        let place = (z - self.start) * self.inverse_spacing;
        let inside = place >= F::zero() && place <= F::from_index(self.cubics.len());
        if inside { slope } else { F::zero() }
    }

    /// The first of the four coefficients that φ(z) depends on, and how much on each: dφ(z)/dw_k, equations (17) and (19).
    #[must_use]
    #[inline(always)]
    pub fn weights(&self, z: F) -> (usize, [F; 4]) {
        let (first, f) = self.place(z);
        let f = f.as_f64();
        let powers = [1.0, f, f * f, f * f * f];
        (
            first as usize,
            BASIS.map(|basis| F::from_f64(dot(basis, powers))),
        )
    }

    /// φ of many, in place.
    pub fn apply(&self, plane: &mut [F]) {
        #[cfg(target_arch = "x86_64")]
        if self.cubics.len() <= INTERVALS
            && let Some(simd) = cpu::v4()
            && let Some(plane) = F::as_f32s(plane)
        {
            return cpu::run(Short {
                simd,
                powers: self
                    .powers
                    .each_ref()
                    .map(|powers| std::array::from_fn(|interval| powers[interval].as_f64() as f32)),
                intervals: self.cubics.len() as f32,
                start: self.start.as_f64() as f32,
                inverse_spacing: self.inverse_spacing.as_f64() as f32,
                hull: (self.hull.0.as_f64() as f32, self.hull.1.as_f64() as f32),
                plane,
            });
        }
        apply(self, plane);
    }

    #[inline(always)]
    fn apply_to(&self, plane: &mut [F]) {
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
        // What is left is done in a group of its own, so that a pixel's value does not depend on its place.
        let mut group = [F::zero(); GROUP];
        group[..rest.len()].copy_from_slice(rest);
        self.apply_to_group(&mut group);
        rest.copy_from_slice(&group[..rest.len()]);
    }

    /// In two loops, each of which becomes vector code; one that does both does not.
    #[inline(always)]
    fn apply_to_group(&self, group: &mut [F; GROUP]) {
        let (mut intervals, mut through) = ([0; GROUP], [F::zero(); GROUP]);
        for place in 0..GROUP {
            (intervals[place], through[place]) = self.place(group[place]);
        }
        let [a, b, c, d] = &*self.powers;
        for place in 0..GROUP {
            let (interval, f) = (usize::from(intervals[place] as u8), through[place]);
            let value = ((d[interval] * f + c[interval]) * f + b[interval]) * f + a[interval];
            group[place] = clamp(value, self.hull.0, self.hull.1);
        }
    }

    /// The knot interval of z, and how far z is through it. On a knot either of the two that meet there, since φ and its slope
    /// go on smoothly.
    #[inline(always)]
    fn place(&self, z: F) -> (u32, F) {
        let intervals = F::from_index(self.cubics.len());
        let half = F::from_f64(0.5);
        let place = (z - self.start) * self.inverse_spacing;
        let place = clamp(place, F::zero(), intervals);
        let (first, index) = clamp(place - half, F::zero(), intervals - F::one()).nearest();
        (index, place - first)
    }
}

/// Sums that take turns.
const TURNS: usize = 2;
/// Inputs of one sum.
const STRETCH: usize = 4096;

impl<F: Real> Spline<F> {
    /// Pushes a gradient through φ: from that of φ(z) to that of z, in place, and to that of the coefficients, which is added.
    pub(crate) fn push(&self, inputs: &[F], gradient: &mut [F], of_coefficients: &mut [f64]) {
        push(self, inputs, gradient, of_coefficients);
    }

    #[inline(always)]
    fn push_on(&self, inputs: &[F], gradient: &mut [F], of_coefficients: &mut [f64]) {
        // Of each knot interval Σ gradient · (1, f, f², f³), from which the basis functions' sums follow. Neighbours mostly
        // meet in one interval; its sums take turns, so that none waits for the one before.
        let mut turns = vec![[F::zero(); 4]; TURNS * self.cubics.len()];
        // In stretches, so that no long sum is kept in few bits.
        for (inputs, gradient) in inputs.chunks(STRETCH).zip(gradient.chunks_mut(STRETCH)) {
            for (index, (&z, gradient)) in inputs.iter().zip(gradient).enumerate() {
                let (first, f) = self.place(z);
                let first = first as usize;
                let sums = &mut turns[first * TURNS + index % TURNS];
                let squared = *gradient * f * f;
                let powers = [*gradient, *gradient * f, squared, squared * f];
                for k in 0..4 {
                    sums[k] += powers[k];
                }
                *gradient *= self.slope_at(z, first, f);
            }
            for (first, turns) in turns.chunks_exact_mut(TURNS).enumerate() {
                let mut sums = [0.0; 4];
                for turn in turns {
                    for (sum, part) in sums.iter_mut().zip(turn) {
                        *sum += std::mem::take(part).as_f64();
                    }
                }
                for (out, powers) in of_coefficients[first..].iter_mut().zip(BASIS) {
                    *out += dot(powers, sums);
                }
            }
        }
    }
}

levels! {
    fn apply[F: Real](spline: &Spline<F>, plane: &mut [F]) = Spline::apply_to;
    fn push[F: Real](
        spline: &Spline<F>, inputs: &[F], gradient: &mut [F], of_coefficients: &mut [f64],
    ) = Spline::push_on;
}

/// `low` for NaN.
#[inline(always)]
pub(crate) fn clamp<F: Real>(x: F, low: F, high: F) -> F {
    let x = if x > low { x } else { low };
    if x < high { x } else { high }
}

/// What four coefficients in a row amount to between the knots that they share, in powers of the distance.
fn cubic<F: Real>(w: &[F]) -> [F; 4] {
    std::array::from_fn(|power| {
        let terms = w
            .iter()
            .zip(BASIS)
            .map(|(w, basis)| w.as_f64() * basis[power]);
        F::from_f64(terms.sum())
    })
}

/// The four cubic B-splines that are not zero past a knot, in powers of the distance f in \[0, 1\] past it.
const BASIS: [[f64; 4]; 4] = [
    [1.0 / 6.0, -0.5, 0.5, -1.0 / 6.0],
    [4.0 / 6.0, 0.0, -1.0, 0.5],
    [1.0 / 6.0, 0.5, 0.5, -0.5],
    [0.0, 0.0, 0.0, 1.0 / 6.0],
];

fn dot(a: [f64; 4], b: [f64; 4]) -> f64 {
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
    fn even_coefficients_make_a_line() {
        let spline = Spline::new(&[-1.0, 0.0, 1.0, 2.0, 3.0], 10.0, 2.0);
        for z in [10.0f64, 10.5, 12.0, 13.7, 14.0] {
            assert!((spline.value(z) - (z - 10.0) / 2.0).abs() < 1e-12);
            assert!((spline.slope(z) - 0.5).abs() < 1e-12);
        }
    }
}
