//! The error type of the engine.

/// The reason why the engine refuses a call. The message states the expected and the received
/// value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An array has the wrong shape, or the shapes of two arrays do not match.
    #[error("{what}: expected {expected}, got {received}")]
    Shape {
        /// The name of the array.
        what: &'static str,
        /// The shape or length that the engine expects.
        expected: String,
        /// The shape or length of the argument.
        received: String,
    },
    /// A value lies outside its range.
    #[error("{what}: expected {expected}, got {received}")]
    Range {
        /// The name of the value.
        what: &'static str,
        /// The range, or the list of valid values.
        expected: String,
        /// The value of the argument.
        received: String,
    },
    /// The operating system cannot start the threads.
    #[error("threads: cannot start {threads} threads ({reason}); pass a smaller number")]
    Threads {
        /// The number of threads that the call requests.
        threads: usize,
        /// The reason that the operating system states.
        reason: String,
    },
    /// The memory for an array is not available.
    #[error(
        "{what}: not enough memory for an array of the shape {shape}; request less at once, such as a part of the image"
    )]
    Memory {
        /// The name of the array.
        what: &'static str,
        /// The shape of the array.
        shape: String,
    },
    /// A file cannot be read, or has other contents than expected.
    #[error("{name}: {reason}")]
    File {
        /// The name of the file.
        name: String,
        /// The reason, with what was expected.
        reason: String,
    },
    /// The caller has interrupted the call, so its result is incomplete.
    #[error("the call was interrupted, so it has no result")]
    Interrupted,
}

impl Error {
    /// Return the error of a shape. An expectation in words is a `format_args!`, which has no quotes.
    pub(crate) fn shape(
        what: &'static str,
        expected: impl std::fmt::Debug,
        received: impl std::fmt::Debug,
    ) -> Self {
        Self::Shape {
            what,
            expected: format!("{expected:?}"),
            received: format!("{received:?}"),
        }
    }

    /// Return the error of an output that has another shape, or whose rows are not contiguous.
    pub(crate) fn layout(
        expected: impl std::fmt::Debug,
        received: impl std::fmt::Debug,
        strides: &[isize],
    ) -> Self {
        Self::Shape {
            what: "out",
            expected: format!("contiguous rows of the shape {expected:?}"),
            received: format!("the shape {received:?} with strides {strides:?}"),
        }
    }

    pub(crate) fn range(
        what: &'static str,
        expected: impl Into<String>,
        received: impl std::fmt::Display,
    ) -> Self {
        Self::Range {
            what,
            expected: expected.into(),
            received: received.to_string(),
        }
    }
}

/// The result of a call to the engine.
pub type Result<T> = std::result::Result<T, Error>;

/// Check the shape or the length of an array.
pub(crate) fn check_shape<Shape: PartialEq + std::fmt::Debug>(
    what: &'static str,
    expected: Shape,
    received: Shape,
) -> Result<()> {
    if received == expected {
        return Ok(());
    }
    Err(Error::shape(what, expected, received))
}
