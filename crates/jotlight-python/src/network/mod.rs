//! The binding of the network: its layers, its forward pass, its splines, and its training.

mod dim_scenes;
mod inference;
mod layers;
mod model;
mod splines;
mod training;
mod trials;

pub use dim_scenes::{
    PyCombined, add_coarse, has_few_photons, match_dark_regions, may_be_dim, may_have_dark_regions,
    sum_counts, trials_per_combined,
};
pub use inference::forward;
pub use layers::PreparedLayer;
pub use model::PyNetwork;
pub use splines::{activate, activate_backward};
pub use training::{gradient, normal_equations, squared_errors};
pub use trials::{conditioning_weights, level_weights, local_trials};
