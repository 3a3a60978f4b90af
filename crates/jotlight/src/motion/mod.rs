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
//!
//! The submodules in reading order:
//!
//! 1. `field` holds displacements, `columns` interpolates them between tiles, `bounds` bounds them,
//!    and `row` computes those of a row. `rounding` rounds them to shifts.
//! 2. `lines` and `search` find parts of rows with one shift, `source` copies the bits that such
//!    parts see, and `frames` divides the frames into groups.
//! 3. `shifted_counts` counts the bits along a motion, with the counters of `row_counter` and the
//!    shifts of `shift_sums`. `shifted_values` adds values of the jots instead.
//! 4. `count` and `sums` hold the results for a block of frames. `block_sums` adds them, and
//!    `remainders` changes their motion.
//! 5. `boxes` and `gradient` compute with rows of images.
//! 6. `template` holds the probabilities to which blocks are compared, and `brightness` the
//!    brightness of a block.
//! 7. `equations` computes the normal equations of tiles. `affine` fits an affine motion to them,
//!    `fits` does so for many blocks, and `solve_field` computes smooth fields with `tile_matrix`.
//!    `curve` joins the affine motions of blocks in time.
//! 8. `chi_squared` tests which pixels agree with the template, `acceptance` adds their counts, and
//!    `disagreement` compares parts of the frames.
//! 9. `velocity_scores` and `shifted_scores` search for motions from the start, by the correlations
//!    of `spectra`.
//! 10. `object_gain` compares objects with what is behind them, `relative` relates the pixels of
//!     both, and `short_outlines` draws their outlines.

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
pub use count::{Count, Counts};
pub use curve::{Curve, Logarithms, MODES};
pub use disagreement::{SQUARE, disagreement, relative_brightness};
pub use equations::{Equations, EquationsView, TILE, normal_equations};
pub use field::Displacements;
pub use fits::{Share, fit_blocks};
pub use gradient::undo_remainders;
pub use lines::BLOCK;
pub use object_gain::{GAINS, Object, PREDICTIONS, Seen, add_object_gain, mark_covered};
pub use relative::Relative;
pub use remainders::changed_remainders;
pub use shifted_counts::{ShiftedCounts, count_shifted};
pub use shifted_scores::{Peak, peak_of_shifted_scores};
pub use shifted_values::add_shifted_values;
pub use short_outlines::shortest_outlines;
pub use solve_field::{Smoothness, Start, solve_field};
pub use sums::Sums;
pub use template::Template;
pub use velocity_scores::{Windows, velocity_scores};
