//! The engine's one error type.

/// What can be wrong with a call to the engine. Each message says what was expected and what came.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// Two arrays, or an array and a number, do not fit together.
    #[error("{what}: expected {expected}, got {given}")]
    Shape {
        /// Which array.
        what: &'static str,
        /// The shape or size that would fit.
        expected: String,
        /// The shape or size that came.
        given: String,
    },
    /// A number lies outside of its range.
    #[error("{what}: expected {expected}, got {given}")]
    Range {
        /// Which number.
        what: &'static str,
        /// The range.
        expected: &'static str,
        /// The number that came.
        given: String,
    },
    /// The pool of threads could not be started.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What the operating system said.
        reason: String,
    },
}

impl Error {
    pub(crate) fn shape(
        what: &'static str,
        expected: impl std::fmt::Debug,
        given: impl std::fmt::Debug,
    ) -> Self {
        Self::Shape {
            what,
            expected: format!("{expected:?}"),
            given: format!("{given:?}"),
        }
    }

    pub(crate) fn range(
        what: &'static str,
        expected: &'static str,
        given: impl std::fmt::Display,
    ) -> Self {
        Self::Range {
            what,
            expected,
            given: given.to_string(),
        }
    }
}

/// The result of a call to the engine.
pub type Result<T> = std::result::Result<T, Error>;
