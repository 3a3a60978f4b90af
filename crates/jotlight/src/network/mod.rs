//! The learned network (paper, section 3.1): layers of linear filters and pointwise cubic
//! B-splines.
//!
//! The functions are generic over `f32` and `f64`. `f32` computes images. Tests use `f64` for
//! accurate reference values.

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
pub use spline::channels::Splines;
pub use spline::evaluate::Spline;
pub use tiling::dependencies::input_rows;
pub use training::batch::{Batch, Gradient, NormalEquations, Patch};
