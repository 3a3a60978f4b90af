//! Tiles of an image.

pub(crate) mod region;
pub(crate) mod workspace;
