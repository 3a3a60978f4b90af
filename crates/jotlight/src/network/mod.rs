//! The learned network (paper, section 3): layers of linear filters and pointwise cubic B-splines,
//! and the derivatives for their training.
//!
//! The submodules in reading order:
//!
//! 1. `layer` and `graph` define a layer, and check the connections of the layers.
//! 2. `first_layer` filters the bits or counts of a sensor (equation (11)).
//! 3. `convolution` holds the filters of all other layers (equation (9)).
//! 4. `spline` holds the nonlinearities φ (equations (8) and (10)).
//! 5. `precision` rounds filters and planes to bfloat16.
//! 6. `tiling` evaluates the layers tile by tile, so that the data stay in the cache.
//! 7. `forward` computes an image with all of these.
//! 8. `model` reads networks from files, computes their parameters for a K, and reconstructs images.
//! 9. `training` computes the cost, its gradient, and the normal equations (equations (12)
//!    and (14) to (19)).
//! 10. `compiled` compiles these functions for both types of numbers.
//!
//! Functions are generic over `f32` and `f64`. Images are computed in `f32`. Tests use `f64` for
//! accurate reference values.
//!
//! Reconstructions need [`Network`], [`SensorModel`], and [`Reconstruction`] only. The Python package
//! combines networks in other ways, and needs some of their parts: [`level_weights`],
//! [`local_trials`], [`conditioning_weights`], [`BRIGHT`], [`RATIO_OF_PASS`], [`write_images`],
//! [`Compiled`], [`Network::conditioned`], [`Network::run_counts`], [`Network::denoise`],
//! [`Combined`], [`trials_per_combined`], [`match_dark_regions`], [`Squares`], and [`add_coarse`].

mod compiled;
mod convolution;
mod first_layer;
mod forward;
mod graph;
mod images;
mod layer;
mod model;
mod precision;
mod spline;
mod tiling;
mod training;

pub use compiled::Compiled;
pub use forward::{
    forward, forward_bits, forward_counts, forward_planes, forward_tied_bits, masked_sums,
};
pub use images::write_images;
pub use layer::{Layer, Wiring};
pub use model::{
    BRIGHT, Combined, EquivalentCounts, LayerParameters, LocalTrials, Network, OfSquares, Pixels,
    RATIO_OF_PASS, Reconstruction, SensorModel, Served, Squares, add_coarse, conditioning_weights,
    level_weights, local_trials, match_dark_regions, trials_per_combined,
};
pub use precision::Precision;
pub use spline::channels::Splines;
pub use spline::evaluate::Spline;
pub use training::batch::{Batch, Gradient, NormalEquations, Patch};
