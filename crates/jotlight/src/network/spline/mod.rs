//! The pointwise nonlinearity: cubic B-splines.

pub(crate) mod backward;
pub(crate) mod evaluate;
#[cfg(target_arch = "x86_64")]
pub(crate) mod registers;
