//! The linear shift-invariant filters, equation (9), and their adjoints.

pub(crate) mod adjoint;
pub(crate) mod channel_bank;
pub(crate) mod direct;
pub(crate) mod winograd;
