//! The cost of a network on training images, its gradient, and its normal equations.

mod backward;
pub(crate) mod batch;
mod jacobian;
mod patch;
