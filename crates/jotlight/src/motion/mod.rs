//! Motion: counts of bits that follow a moving scene, and what alignment computes from them.
//!
//! A *motion* has a displacement u(x, t) for each pixel x and frame t. The scene point that pixel x
//! shows at the reference time is at x + u(x, t) in frame t. The pixel counts the bit at this
//! position, rounded to whole pixels. So counts remain sums of whole bits, and their noise remains
//! independent. The *shift* is the rounded displacement, and the *remainder* is the difference
//! between shift and displacement.
//!
//! The counts of a block of frames are compared with a [`Template`]. [`normal_equations`] are about
//! the displacement errors of tiles of pixels, and [`fit_affine`] and [`solve_field`] solve them for
//! all tiles together. [`chi_squared`] tests which pixels agree with the template, and
//! [`disagreement`] compares two parts of the frames.
//!
//! [`velocity_scores`] computes how probable velocities are in windows of the scene. The alignment
//! begins with it. [`add_object_gain`] computes where objects explain the bits better than what is
//! behind them.

mod acceptance;
mod affine;
mod block_sums;
mod bounds;
mod boxes;
mod brightness;
mod chi_squared;
mod columns;
mod count;
mod curve;
mod disagreement;
mod equations;
mod field;
mod filter;
mod fits;
mod frames;
mod gradient;
mod lines;
mod object_gain;
mod relative;
mod remainders;
mod rounding;
mod row;
mod row_counter;
mod search;
mod shift_sums;
mod shifted_counts;
mod shifted_scores;
mod shifted_values;
mod short_outlines;
mod solve_field;
mod source;
mod spectra;
mod sums;
mod template;
mod tile_matrix;
mod velocity_scores;

pub use acceptance::{Limits, Tested, Totals, accept_agreeing};
pub use affine::{AffineFit, fit_affine};
pub use block_sums::{Accepted, add_accepted, add_counts};
pub use brightness::brightness_of;
pub use chi_squared::{Comparison, chi_squared};
pub use count::Count;
pub use curve::{Curve, Logarithms, MODES};
pub use disagreement::{Counts, SQUARE, disagreement, relative_brightness};
pub use equations::{Equations, EquationsView, TILE, normal_equations};
pub use field::Displacements;
pub use filter::blur;
pub use fits::{Share, fit_blocks};
pub use gradient::undo_remainders;
pub use object_gain::{GAINS, Object, PREDICTIONS, Seen, add_object_gain, mark_covered};
pub use relative::Relative;
pub use remainders::changed_remainders;
pub use shifted_counts::{BLOCK, ShiftedCounts, count_shifted};
pub use shifted_scores::{Peak, peak_of_shifted_scores};
pub use shifted_values::add_shifted_values;
pub use short_outlines::shortest_outlines;
pub use solve_field::{Smoothness, Start, solve_field};
pub use sums::Sums;
pub use template::Template;
pub use velocity_scores::{Windows, velocity_scores};
