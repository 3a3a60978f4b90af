//! The binding of the network: its layers, its forward pass, its splines, and its training.

mod inference;
mod layers;
mod model;
mod splines;
mod training;
mod trials;

pub use inference::forward;
pub use layers::PreparedLayer;
pub use model::PyNetwork;
pub use splines::{activate, activate_backward};
pub use training::{gradient, normal_equations, squared_errors};
pub use trials::{conditioning_weights, level_weights, local_trials};
