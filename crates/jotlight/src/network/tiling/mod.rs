//! Evaluation of a network in tiles of the image.
//!
//! Tiles lie one below the other. Each passes through all layers while its planes are in the cache.
//! The rows of a layer that the next tile needs are kept, so that no row is computed twice.

pub(crate) mod dependencies;
pub(crate) mod region;
pub(crate) mod schedule;
mod strip_workspace;
pub(crate) mod strips;
mod workspace;
