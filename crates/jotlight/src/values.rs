//! Parameters that are either one value for all elements or one value per element.

use std::ops::Range;

use crate::error::{Error, Result};

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
