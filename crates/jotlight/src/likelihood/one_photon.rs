//! The likelihood of many cells at a time for the threshold of one photon, where P = 1 − e^(−s): one body that the compiler turns into vector code.

use super::{Cells, DARKEST, ROUNDS, first_try};
use crate::cpu::levels;

/// Cells side by side.
const LANES: usize = 16;
type Lanes = [f64; LANES];

levels! {
    /// The gradient and the curvature of ℓ, as [`super::Seen::slopes`] gives them.
    pub(super) fn slopes(
        cells: &Cells, light: &[f64], gradient: &mut [f64], curvature: &mut [f64],
    ) = slopes_inlined;
    /// The proximal map of −ℓ: Newton's method between bounds, as [`super::Seen::nearest`] does for one cell.
    pub(super) fn nearest(
        cells: &Cells, limits: (f64, f64, f64), guess: &[f64], point: &mut [f64],
    ) = nearest_inlined;
}

#[inline(always)]
fn slopes_inlined(cells: &Cells, light: &[f64], gradient: &mut [f64], curvature: &mut [f64]) {
    for start in (0..light.len()).step_by(LANES) {
        let group = Group::of(cells, start);
        let (score, bend) = group.slopes(&lanes(light, start));
        store(&score, start, gradient);
        store(&bend, start, curvature);
    }
}

#[inline(always)]
fn nearest_inlined(
    cells: &Cells,
    (penalty, most, tolerance): (f64, f64, f64),
    guess: &[f64],
    point: &mut [f64],
) {
    for start in (0..point.len()).step_by(LANES) {
        let group = Group::of(cells, start);
        let goal = lanes(point, start);
        let mut x = lanes(guess, start);
        let (at_0, _) = group.rise(&[0.0; LANES], &goal, penalty);
        let (at_most, _) = group.rise(&[most; LANES], &goal, penalty);
        let mut done = [false; LANES];
        for lane in 0..LANES {
            // The slope rises: where it is above 0 from the start, or below 0 to the end, the root lies outside.
            done[lane] = at_0[lane] >= 0.0 || at_most[lane] <= 0.0;
            x[lane] = if at_0[lane] >= 0.0 {
                0.0
            } else if at_most[lane] <= 0.0 {
                most
            } else {
                first_try(x[lane], most)
            };
        }
        let (mut low, mut high) = ([0.0; LANES], [most; LANES]);
        for _ in 0..ROUNDS {
            let (slope, bend) = group.rise(&x, &goal, penalty);
            let mut left = false;
            for lane in 0..LANES {
                let above = slope[lane] > 0.0;
                high[lane] = if above { x[lane] } else { high[lane] };
                low[lane] = if above { low[lane] } else { x[lane] };
                let step = x[lane] - slope[lane] / bend[lane];
                let newton =
                    step > low[lane] && step < high[lane] || step.to_bits() == x[lane].to_bits();
                let next = if newton {
                    step
                } else {
                    0.5 * (low[lane] + high[lane])
                };
                let near = newton && (next - x[lane]).abs() <= tolerance * next
                    || high[lane] - low[lane] <= f64::EPSILON * high[lane];
                x[lane] = if done[lane] { x[lane] } else { next };
                done[lane] |= near;
                left |= !done[lane];
            }
            if !left {
                break;
            }
        }
        store(&x, start, point);
    }
}

/// What so many cells saw; past the end of a stretch, cells without a bit.
struct Group {
    ones: Lanes,
    zeros: Lanes,
    efficiency: Lanes,
    dark: Lanes,
}

impl Group {
    #[inline(always)]
    fn of(cells: &Cells, start: usize) -> Self {
        Self {
            ones: lanes(&cells.ones, start),
            zeros: lanes(&cells.zeros, start),
            efficiency: lanes(&cells.efficiency, start),
            dark: lanes(&cells.dark, start),
        }
    }

    /// ∂ℓ/∂s = η (L / (e^(η s + d) − 1) − (n − L)), and the curvature.
    #[inline(always)]
    fn slopes(&self, light: &Lanes) -> (Lanes, Lanes) {
        let mut rate = [0.0; LANES];
        for lane in 0..LANES {
            rate[lane] = (self.efficiency[lane] * light[lane] + self.dark[lane]).max(DARKEST);
        }
        let grown = exp_m1(&rate);
        let (mut gradient, mut curvature) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            let score = 1.0 / grown[lane];
            let efficiency = self.efficiency[lane];
            gradient[lane] = efficiency * (self.ones[lane] * score - self.zeros[lane]);
            curvature[lane] = efficiency * efficiency * (self.ones[lane] * (score * (score + 1.0)));
        }
        (gradient, curvature)
    }

    /// The slope of −ℓ(x) + ½ penalty (x − goal)², and its own.
    #[inline(always)]
    fn rise(&self, x: &Lanes, goal: &Lanes, penalty: f64) -> (Lanes, Lanes) {
        let (mut slope, mut bend) = self.slopes(x);
        for lane in 0..LANES {
            slope[lane] = penalty * (x[lane] - goal[lane]) - slope[lane];
            bend[lane] += penalty;
        }
        (slope, bend)
    }
}

#[inline(always)]
fn lanes(values: &[f64], start: usize) -> Lanes {
    let values = &values[start..];
    if let Some(whole) = values.first_chunk() {
        return *whole;
    }
    let mut part = [0.0; LANES];
    part[..values.len()].copy_from_slice(values);
    part
}

#[inline(always)]
fn store(lanes: &Lanes, start: usize, out: &mut [f64]) {
    let out = &mut out[start..];
    let length = out.len().min(LANES);
    out[..length].copy_from_slice(&lanes[..length]);
}

/// e^x − 1 for x ≥ 0, to a few units of the last digit; past 709 as for 709.
///
/// x = k ln 2 + r with |r| ≤ ½ ln 2, and e^x − 1 = 2^k (e^r − 1) + (2^k − 1), with the series of e^r − 1 to its 13th term.
#[inline(always)]
fn exp_m1(x: &Lanes) -> Lanes {
    // Adding this leaves the nearest whole number in the lowest bits.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    const LN_2_HIGH: f64 = 0.693_147_180_369_123_8;
    const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;
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
    let mut grown = [0.0; LANES];
    for lane in 0..LANES {
        let x = x[lane].min(709.0);
        let shifted = x * std::f64::consts::LOG2_E + SHIFT;
        let k = shifted - SHIFT;
        let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
        let mut sum = SERIES[0];
        for term in &SERIES[1..] {
            sum = sum * r + term;
        }
        let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
        grown[lane] = power * (r + r * r * sum) + (power - 1.0);
    }
    grown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_that_of_the_library() {
        let mut x = 1e-150;
        while x < 709.0 {
            let grown = exp_m1(&[x; LANES])[0];
            let exact = x.exp_m1();
            assert!(
                (grown - exact).abs() <= 4.0 * f64::EPSILON * exact,
                "{x}: {grown} instead of {exact}"
            );
            x *= 1.0 + 1e-3;
        }
        assert!(exp_m1(&[1e4; LANES])[0] > 1e307);
    }
}
