//! Tests of the engine that may run at the same time in one program.
//!
//! The compiler translates the engine's generic functions once for each program. Tests that choose
//! the level of instructions of all threads are another program, `levels`.

#[path = "../random/mod.rs"]
mod random;

mod edge_cases;
mod interrupt;
mod likelihood;
mod mle;
mod model;
mod model_corrections;
mod model_data;
mod model_images;
mod motion_curve;
mod motion_sums;
mod motion_velocity;
mod network;
mod network_gradients;
mod parameters;
mod sensing;
mod sensing_parameters;
mod splines;
mod spread;
mod threshold;
mod tv;
mod vst;
