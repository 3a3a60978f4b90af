//! Motion: counts of bits that follow a moving scene.
//!
//! A *motion* has a displacement u(x, t) for each pixel x and frame t. The scene point that pixel x
//! shows at the reference time is at x + u(x, t) in frame t. The pixel counts the bit at this
//! position, rounded to whole pixels. So counts remain sums of whole bits, and their noise remains
//! independent. The *shift* is the rounded displacement, and the *remainder* is the difference
//! between shift and displacement.

mod columns;
mod field;
mod frames;
mod lines;
mod row;
mod row_counter;
mod search;
mod shifted_counts;
mod source;

pub use field::Displacements;
pub use shifted_counts::{BLOCK, ShiftedCounts, add_shifted_counts};
