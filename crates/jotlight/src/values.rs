//! Parameters that are either one value for all elements or one value per element.

use std::ops::Range;

use rayon::prelude::*;

use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::numbers::Real;

/// The number of values that a thread checks together.
const VALUES_PER_TASK: usize = 1 << 14;

/// One value for all elements of an array, or one value per element.
#[derive(Clone, Copy, Debug)]
pub enum Values<'a, T> {
    /// The value of all elements.
    Same(T),
    /// The value of each element, in row-major order.
    Each(&'a [T]),
}

impl<T: Copy> Values<'_, T> {
    /// Return the values of a range of elements.
    ///
    /// # Panics
    /// If there are fewer elements.
    #[must_use]
    pub fn part(&self, elements: Range<usize>) -> Self {
        match *self {
            Self::Same(value) => Self::Same(value),
            Self::Each(values) => Self::Each(&values[elements]),
        }
    }

    /// Return the values of each of `images` images, which have `pixels` elements.
    pub(crate) fn of_images(self, images: usize, pixels: usize) -> impl Iterator<Item = Self> {
        (0..images).map(move |image| self.part(image * pixels..(image + 1) * pixels))
    }

    pub(crate) fn get(&self, index: usize) -> T {
        match self {
            Self::Same(value) => *value,
            Self::Each(values) => values[index],
        }
    }

    pub(crate) fn check_length(&self, what: &'static str, length: usize) -> Result<()> {
        match self {
            Self::Each(values) if values.len() != length => {
                Err(Error::shape(what, length, values.len()))
            }
            _ => Ok(()),
        }
    }
}

impl Values<'_, f64> {
    /// Check that there is one value, or one per element, and that each is finite and at least 0.
    pub(crate) fn check(&self, what: &'static str, length: usize) -> Result<()> {
        self.check_length(what, length)?;
        match self {
            Self::Same(value) => check_not_negative(what, std::slice::from_ref(value)),
            Self::Each(values) => check_not_negative(what, values),
        }
    }
}

/// Check that numbers are finite and at least 0.
pub(crate) fn check_not_negative<F: Real>(what: &'static str, values: &[F]) -> Result<()> {
    let find = |values: &[F]| {
        let mut are_valid = true;
        include_validity(values, &mut are_valid);
        let wrong = || values.iter().copied().find(|&value| !is_valid(value));
        if are_valid { None } else { wrong() }
    };
    let wrong = if values.len() <= VALUES_PER_TASK {
        find(values)
    } else {
        values.par_chunks(VALUES_PER_TASK).find_map_first(find)
    };
    wrong.map_or(Ok(()), |wrong| {
        let expected = "finite numbers of at least 0";
        Err(Error::range(what, expected, wrong.as_f64()))
    })
}

/// Check that values are numbers, which may be infinite.
pub(crate) fn check_numbers(what: &'static str, values: &[f64]) -> Result<()> {
    let chunks = values.par_chunks(VALUES_PER_TASK);
    match chunks.find_any(|values| values.iter().any(|value| value.is_nan())) {
        Some(_) => Err(Error::range(what, "numbers", f64::NAN)),
        None => Ok(()),
    }
}

#[inline(always)]
fn is_valid<F: Real>(value: F) -> bool {
    (value >= F::zero()) & value.is_finite()
}

levels! {
    /// Set `are_valid` to false if a number is infinite, NaN, or negative.
    fn include_validity[F: Real](values: &[F], are_valid: &mut bool) = include_validity_inlined;
}

#[inline(always)]
fn include_validity_inlined<F: Real>(values: &[F], are_valid: &mut bool) {
    // Without an early end, the compiler vectorizes the search.
    *are_valid &= values
        .iter()
        .fold(true, |all, &value| all & is_valid(value));
}

/// Check that a number is finite and above 0.
pub(crate) fn check_positive(what: &'static str, value: f64) -> Result<()> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(Error::range(what, "a finite number above 0", value))
    }
}
