//! Counts of pixels.

use ndarray::ArrayView2;

/// The ones and trials of each pixel, `(H, W)`.
#[derive(Clone, Copy, Debug)]
pub struct Counts<'a, C = i32> {
    /// N, the number of ones.
    pub ones: ArrayView2<'a, C>,
    /// D, the number of valid bits.
    pub trials: ArrayView2<'a, C>,
}

/// The number of ones or of trials of a pixel.
///
/// Bits are counted in whole numbers. Real numbers are the counts that another sensor would have on
/// average, so those of ones may lie outside the range from 0 to the number of trials. Other types
/// cannot implement this trait.
pub trait Count: Sealed + Copy + PartialOrd + std::fmt::Debug + Send + Sync + 'static {
    /// What numbers of ones and trials are expected, for messages.
    const EXPECTED: &'static str;

    /// Return the count in single precision.
    fn to_f32(self) -> f32;

    /// Return the count in double precision.
    fn to_f64(self) -> f64;

    /// Return the sum of counts.
    fn sum(counts: &[Self]) -> f64;

    /// Return whether a pixel can have these numbers of ones and trials.
    fn are_possible(ones: Self, trials: Self) -> bool;
}

mod sealed {
    pub trait Sealed {}
    impl Sealed for i32 {}
    impl Sealed for f32 {}
}
use sealed::Sealed;

impl Count for i32 {
    const EXPECTED: &'static str = "0 to that of trials";

    #[inline(always)]
    fn to_f32(self) -> f32 {
        self as f32
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn sum(counts: &[Self]) -> f64 {
        let sum: i64 = counts.iter().map(|&count| i64::from(count)).sum();
        sum as f64
    }

    #[inline(always)]
    fn are_possible(ones: Self, trials: Self) -> bool {
        ones >= 0 && ones <= trials
    }
}

impl Count for f32 {
    const EXPECTED: &'static str = "finite numbers, and trials of at least 0";

    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn sum(counts: &[Self]) -> f64 {
        counts.iter().copied().map(f64::from).sum()
    }

    #[inline(always)]
    fn are_possible(ones: Self, trials: Self) -> bool {
        ones.is_finite() && trials.is_finite() && trials >= 0.0
    }
}
