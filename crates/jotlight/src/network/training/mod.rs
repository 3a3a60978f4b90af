//! Cost, gradient and normal equations.

pub(crate) mod backward;
pub(crate) mod batch;
pub(crate) mod jacobian;
