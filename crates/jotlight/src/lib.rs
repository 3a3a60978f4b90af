//! The engine of jotlight: pictures from the bits of single-photon cameras.
//!
//! All loops of the project live here; files, plots and Python do not. The words are those of the field:
//! a *jot* is one tiny one-bit pixel, and the `K = T·K̂²` bits of a `K̂ × K̂` block of jots over `T` frames
//! make one *pixel* of the picture. Every function gives the same result for any number of threads.
//!
//! ```
//! use jotlight::likelihood::Threshold;
//!
//! let one_photon = Threshold::new(1)?;
//! assert!((one_photon.fires(0.5) - (1.0 - (-0.5f64).exp())).abs() < 1e-15);
//! # Ok::<(), jotlight::error::Error>(())
//! ```

pub mod bits;
pub mod cpu;
pub mod error;
pub mod likelihood;
pub mod mle;
pub mod network;
pub mod numbers;
pub mod rng;
pub mod roofline;
pub mod sensing;
pub mod threads;
pub mod tv;
pub mod vst;
