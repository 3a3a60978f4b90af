//! The binding of the network: its layers, its forward pass, its splines, and its training.

mod inference;
mod layers;
mod splines;
mod training;

pub use inference::{forward, forward_bits, forward_counts, forward_tied_bits, masked_sums};
pub use layers::PreparedLayer;
pub use splines::{activate, activate_backward};
pub use training::{gradient, normal_equations, squared_errors};
