//! Pseudorandom numbers for tests.
#![allow(dead_code, reason = "each program of tests uses some of them")]

use jotlight::bits::packed_width;
use ndarray::Array3;

/// A linear congruential generator.
pub struct Random(pub u32);

impl Random {
    /// Return 24 bits.
    pub fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        self.0 >> 8
    }

    /// Return eight bits.
    pub fn byte(&mut self) -> u8 {
        (self.bits() >> 16) as u8
    }

    /// Return an integer from 0 to `end` − 1.
    pub fn below(&mut self, end: u32) -> u32 {
        self.bits() % end
    }

    /// Return a number in [0, 1).
    pub fn fraction(&mut self) -> f64 {
        f64::from(self.bits()) / f64::from(1 << 24)
    }

    /// Return a number in [−1, 1).
    pub fn number(&mut self) -> f64 {
        2.0 * self.fraction() - 1.0
    }
}

/// Return packed frames of a given width in jots. Their padding bits are random too.
pub fn random_bits(frames: usize, rows: usize, width: usize) -> Array3<u8> {
    let mut random = Random(0x2016);
    Array3::from_shape_simple_fn((frames, rows, packed_width(width)), || random.byte())
}
