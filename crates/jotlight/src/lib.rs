//! The engine of jotlight, which reconstructs images from the bits of single-photon cameras.
//!
//! A *jot* is a pixel of the sensor. It reports one bit per frame: 1 if at least q photons arrive.
//! A *pixel* of the image covers a block of `K̂ × K̂` jots. The sensor records `T` frames, so each
//! pixel has `K = T·K̂²` bits. The engine simulates these bits, and estimates the image from them.
//!
//! The engine contains all loops over jots and pixels. It does not depend on Python. It reads no
//! files but those of networks ([`network::Network`], feature `safetensors`, on by default). Every
//! function but the measurements of [`roofline`] returns the same result for any number of threads.
//! The target must have 64-bit addresses.
//!
//! The equations, sections, and symbols are those of the paper *Learning optimal parameters for
//! binary sensing image reconstruction algorithms*. `docs/notation.md` lists all symbols.
//!
//! # Modules in reading order
//!
//! The sensor and its data:
//!
//! 1. [`sensing`] computes the detection probability of each jot from an image, draws the bits,
//!    and applies the linear operator G (section 2.1, equations (1) to (3)).
//! 2. `rng` generates the random numbers of the simulated bits.
//! 3. [`bits`] reads packed bits and counts the ones of each pixel.
//! 4. [`motion`] counts bits that follow a moving scene. It computes the scores, equations, and tests
//!    with which the Python package estimates motions.
//!
//! The estimators without training:
//!
//! 5. [`likelihood`] evaluates the log-likelihood of the bits, its derivatives, the Fisher
//!    information, and the proximal map (section 2.2.1, equation (4)).
//! 6. [`multibit`] does the same for readings of several bits and read noise, and draws them.
//! 7. [`joint`] maximizes the likelihood of readings with different gains and thresholds.
//! 8. [`diffusion`] rounds real counts such that the errors of neighbors cancel.
//! 9. [`mle`] computes the maximum-likelihood estimate for the box kernel (equation (5)).
//! 10. [`tv`] computes the total variation, its proximal map, and its ADMM update.
//! 11. [`admm`] holds the parameters that the ADMM updates of `likelihood` and `tv` share.
//! 12. [`vst`] computes the Anscombe transform and its inverses (section 2.2.2, equations (6) and
//!     (7)).
//! 13. [`color_lines`] removes the color fringes of estimates behind a mosaic.
//!
//! The learned network:
//!
//! 14. [`network`] evaluates layers of linear filters and splines (section 3.1, equations (8) to
//!     (11)), and computes the derivatives for training (section 3.3, equations (12) and (14) to
//!     (19)).
//!
//! General modules:
//!
//! 15. [`error`] defines the error type.
//! 16. [`values`] defines parameters that are either one value or one value per element.
//! 17. [`numbers`] defines the floating-point types, and `lanes` their SIMD vectors.
//! 18. [`filter`] blurs images.
//! 19. [`cpu`] selects the instruction set.
//! 20. [`threads`] runs calls on a number of threads, and interrupts them.
//! 21. [`roofline`] measures the peak speed of the processor for the benchmarks.
//!
//! # Example
//!
//! ```
//! use jotlight::likelihood::Threshold;
//!
//! let one_photon = Threshold::new(1)?;
//! let probability = one_photon.detection_probability(0.5);
//! assert!((probability - (1.0 - (-0.5f64).exp())).abs() < 1e-15);
//! # Ok::<(), jotlight::error::Error>(())
//! ```

#[cfg(not(target_pointer_width = "64"))]
compile_error!("jotlight needs a 64-bit target, because sizes and positions exceed 32 bits");

pub mod admm;
pub mod bits;
mod border;
pub mod color_lines;
pub mod cpu;
pub mod diffusion;
mod elementary;
mod elements;
pub mod error;
pub mod filter;
mod images;
mod interrupt;
pub mod joint;
mod kept;
mod lanes;
pub mod likelihood;
mod memory;
pub mod mle;
pub mod motion;
pub mod multibit;
pub mod network;
pub mod numbers;
mod rng;
pub mod roofline;
pub mod sensing;
pub mod threads;
pub mod tv;
pub mod values;
pub mod vst;

/// The examples of the README, which compile.
#[cfg(all(doctest, feature = "safetensors"))]
#[doc = include_str!("../README.md")]
struct Readme;
