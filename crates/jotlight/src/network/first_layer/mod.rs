//! The first layer: filters over the bits of a pixel.

pub(crate) mod bit_tables;
pub(crate) mod block;
pub(crate) mod count_table;
