//! The cost of a network on training images, its gradient, and its normal equations (paper, section
//! 3.3, equations (12) and (14) to (19)).
//!
//! `batch` averages over patches, and `patch` evaluates one of them. `backward` computes the
//! gradient, and `jacobian` the Jacobian.

mod backward;
pub(crate) mod batch;
mod jacobian;
mod patch;
