//! The learned network (paper, section 3.1): layers of linear filters and pointwise cubic B-splines.

mod convolution;
mod first_layer;
mod forward;
mod graph;
mod layer;
mod spline;
mod tiling;
mod training;

pub use forward::{forward, forward_bits, forward_counts, masked_sums};
pub use layer::{Layer, Wiring};
pub use spline::backward::Splines;
pub use spline::evaluate::Spline;
pub use tiling::workspace::rows_needed;
pub use training::batch::{Batch, Gradient, NormalEquations, Patch};
