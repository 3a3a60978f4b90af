//! Linear shift-invariant filters, equation (9), their adjoints, and the gradients with respect to
//! their taps, equation (18). Planes continue symmetrically beyond their borders.
//!
//! `padded` adds the border and convolves, with the taps that `filter_taps` orders. `direct` and
//! `channel_bank` hold its inner loops, for one output and for several. `winograd` is faster for
//! many channels, and `tiles` for bfloat16 on processors with AMX. `adjoint` and `tap_gradient`
//! compute derivatives.

pub(crate) mod adjoint;
mod channel_bank;
mod direct;
pub(crate) mod filter_taps;
pub(crate) mod padded;
mod tap_gradient;
pub(crate) mod tiles;
pub(crate) mod winograd;

/// A stack of planes in memory. Loops may read values beyond the end of a row.
#[derive(Clone, Copy)]
struct PlanesView<'a, F> {
    data: &'a [F],
    /// The distance in memory from one plane to the next.
    plane_stride: usize,
    /// The distance in memory from one row to the next.
    row_stride: usize,
}

/// Return the number of input rows before row stride·m that a filter reads for its output row m.
/// The same holds for columns.
const fn leading_rows(taps: usize, stride: usize) -> usize {
    (taps - stride) / 2
}
