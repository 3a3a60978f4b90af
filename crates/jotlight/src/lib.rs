//! The engine of jotlight: image reconstruction from the bits of single-photon cameras.
//!
//! The crate contains the loops of the project, without files, plots, or Python. A *jot* is a
//! one-bit pixel. The `K = T·K̂²` bits of a `K̂ × K̂` block of jots over `T` frames form one
//! *pixel* of the image. Every function returns the same result for any number of threads.
//!
//! ```
//! use jotlight::likelihood::Threshold;
//!
//! let one_photon = Threshold::new(1)?;
//! let probability = one_photon.detection_probability(0.5);
//! assert!((probability - (1.0 - (-0.5f64).exp())).abs() < 1e-15);
//! # Ok::<(), jotlight::error::Error>(())
//! ```

pub mod admm;
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
pub mod values;
pub mod vst;
