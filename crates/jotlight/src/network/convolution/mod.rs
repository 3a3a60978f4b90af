//! Linear shift-invariant filters, equation (9), their adjoints, and the gradients of their taps.
//!
//! Planes are extended beyond their borders by mirroring.

pub(crate) mod adjoint;
mod channel_bank;
mod direct;
pub(crate) mod filter_taps;
pub(crate) mod padded;
mod tap_gradient;
pub(crate) mod winograd;
mod winograd_transforms;

/// A stack of planes whose rows have space for reads beyond their ends.
#[derive(Clone, Copy)]
struct PlanesView<'a, F> {
    data: &'a [F],
    /// The offset from one plane to the next.
    plane_stride: usize,
    /// The offset from one row to the next.
    row_stride: usize,
}

/// Return the number of rows (or columns) that the filter at output row m reads before row
/// stride·m of the input.
const fn leading_rows(taps: usize, stride: usize) -> usize {
    (taps - stride) / 2
}
