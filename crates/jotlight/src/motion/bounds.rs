//! Bounds of the displacements of a row.

use super::rounding::{fold, margin, max, min, round};

/// The number of values whose bounds are computed together.
const LANES: usize = 8;

/// Bounds of the displacements of a row in one direction.
#[derive(Clone, Copy, Default)]
pub(super) struct Bounds {
    /// The smallest and the largest first value, and the same of the changes.
    first: [f32; 2],
    change: [f32; 2],
    margin: f32,
}

impl Bounds {
    /// Return the bounds of displacements between some values, given the first and the last ones.
    #[inline(always)]
    pub fn new(first: &[f32], last: &[f32]) -> Self {
        let mut low = [[f32::INFINITY; LANES]; 2];
        let mut high = [[f32::NEG_INFINITY; LANES]; 2];
        for (first, last) in first.as_chunks().0.iter().zip(last.as_chunks().0) {
            include(first, last, &mut low, &mut high);
        }
        if let (Some(first), Some(last)) = (first.last_chunk(), last.last_chunk()) {
            include(first, last, &mut low, &mut high);
        }
        let [first, change] = [0, 1].map(|index| [fold(&low[index], min), fold(&high[index], max)]);
        let magnitude = |range: [f32; 2]| max(-range[0], range[1]);
        let magnitude = 3.0 * magnitude(first) + 3.0 * magnitude(change);
        // Equal values stay exactly equal when they are interpolated. So even halves are certain.
        let are_equal = [first, change]
            .iter()
            .all(|range| range[0].to_bits() == range[1].to_bits());
        Self {
            first,
            change,
            margin: if are_equal {
                0.0
            } else {
                margin(0.0, magnitude)
            },
        }
    }

    /// Return the smallest and the largest shift from the first to the last time.
    #[inline(always)]
    pub fn shifts(&self, times: [f32; 2]) -> [i32; 2] {
        let [low, high] = self.change;
        let [a, b] = [times[0] * low, times[0] * high];
        let [c, d] = [times[1] * low, times[1] * high];
        let low = self.first[0] + min(min(a, b), min(c, d));
        let high = self.first[1] + max(max(a, b), max(c, d));
        [round(low - self.margin), round(high + self.margin)]
    }
}

/// Include the first values and the changes of some displacements in their bounds.
#[inline(always)]
fn include(
    first: &[f32; LANES],
    last: &[f32; LANES],
    low: &mut [[f32; LANES]; 2],
    high: &mut [[f32; LANES]; 2],
) {
    for i in 0..LANES {
        let change = last[i] - first[i];
        low[0][i] = min(low[0][i], first[i]);
        low[1][i] = min(low[1][i], change);
        high[0][i] = max(high[0][i], first[i]);
        high[1][i] = max(high[1][i], change);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_displacements_have_one_shift_even_at_halves() {
        let bounds = Bounds::new(&[0.25; 18], &[1000.25; 18]);
        for index in 0..=1000u16 {
            let time = f32::from(index) / 1000.0;
            let shift = round(0.25 + time * 1000.0);
            assert_eq!(bounds.shifts([time; 2]), [shift; 2]);
        }
        assert_eq!(bounds.shifts([0.25e-3; 2]), [0; 2]);
        assert_eq!(bounds.shifts([0.0, 1.0]), [0, 1000]);
    }

    #[test]
    fn displacements_that_differ_have_a_margin() {
        let mut last = [1000.25; 18];
        last[3] += 0.001;
        let bounds = Bounds::new(&[0.25; 18], &last);
        assert_eq!(bounds.shifts([0.25e-3; 2]), [0, 1]);
        assert_eq!(bounds.shifts([0.1; 2]), [100; 2]);
    }
}
