//! The pointwise nonlinearity φ of equations (8) and (10): a cubic B-spline on equally spaced
//! knots.

mod backward;
pub(crate) mod channels;
pub(crate) mod evaluate;
#[cfg(target_arch = "x86_64")]
mod registers;
