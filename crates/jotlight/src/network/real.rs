//! The width of the numbers that a network is run with.

use std::iter::Sum;

use ndarray::NdFloat;

/// `f32` for work; `f64` is the same code with errors too small to matter, which tells what the first should give.
pub trait Real: NdFloat + Sum<Self> + Default {
    /// The nearest number of this width.
    fn from_f64(x: f64) -> Self;
    /// The same number in 64 bits.
    fn as_f64(self) -> f64;
    /// A small whole number.
    fn from_index(index: usize) -> Self;
    /// Rounded down, 0 below 0; below 2³¹.
    fn as_index(self) -> usize;
}

macro_rules! real {
    ($($float:ty),*) => {$(
        impl Real for $float {
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as Self
            }
            #[inline(always)]
            fn as_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            #[allow(clippy::cast_lossless)]
            fn from_index(index: usize) -> Self {
                index as i32 as Self
            }
            #[inline(always)]
            fn as_index(self) -> usize {
                // By way of 32 bits, which processors convert at once.
                self as i32 as usize
            }
        }
    )*};
}
real!(f32, f64);
