//! Random numbers for tests.

/// A linear congruential generator of values in [−0.5, 0.5].
pub struct Random(pub u32);

impl Random {
    /// Returns the next value.
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(self.0) / f64::from(u32::MAX) - 0.5
    }
}
