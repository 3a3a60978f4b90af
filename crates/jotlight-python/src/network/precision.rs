//! Arguments in single or double precision.

use pyo3::prelude::*;

/// An argument whose arrays are all `f32` or all `f64`.
#[derive(FromPyObject)]
pub enum Precision<Single, Double> {
    F32(Single),
    F64(Double),
}

/// Evaluate an expression with the argument in its precision:
/// `for_precision!(layers, layers => expression)`.
macro_rules! for_precision {
    ($argument:expr, $name:ident => $expression:expr) => {
        match $argument {
            $crate::network::precision::Precision::F32($name) => $expression,
            $crate::network::precision::Precision::F64($name) => $expression,
        }
    };
}
pub(super) use for_precision;
