//! The pointwise nonlinearities φ of equations (8) and (10): cubic B-splines with equally spaced
//! knots.
//!
//! `evaluate` computes φ and its derivatives, and `registers` does the same faster with AVX-512.
//! `register_pairs` computes φ faster with AVX2. `backward` computes gradients. `channels` applies
//! one spline per channel.

mod backward;
pub(crate) mod channels;
pub(crate) mod evaluate;
#[cfg(target_arch = "x86_64")]
mod register_pairs;
#[cfg(target_arch = "x86_64")]
mod registers;
