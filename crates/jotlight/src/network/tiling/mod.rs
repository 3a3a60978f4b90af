//! Evaluation of a network in tiles of the image.
//!
//! All layers of a tile are computed while its planes are in the cache. Then the tile below
//! follows. Rows that this tile also needs are kept, so that they are not computed twice.
//!
//! `schedule` divides the image into tiles. `dependencies` computes the regions that each layer of
//! a tile needs. `workspace` evaluates the tiles, and `strip_workspace` one layer on a part of a
//! tile. `interleave` combines rows of pixels. `region` and `strips` hold the data structures.

pub(crate) mod dependencies;
pub(crate) mod interleave;
pub(crate) mod region;
pub(crate) mod schedule;
mod strip_workspace;
pub(crate) mod strips;
mod workspace;
