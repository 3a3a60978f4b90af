//! How many threads a call uses.

use crate::error::{Error, Result};

/// Runs `work` on `threads` threads, or on all of the machine's when `threads` is `None`.
///
/// # Errors
/// [`Error::Range`] for zero threads, [`Error::Threads`] when the pool cannot be started.
pub fn install<R: Send>(threads: Option<usize>, work: impl FnOnce() -> R + Send) -> Result<R> {
    match threads {
        None => Ok(work()),
        Some(0) => Err(Error::range("threads", "at least 1", 0)),
        Some(threads) => rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map(|pool| pool.install(work))
            .map_err(|reason| Error::Threads {
                threads,
                reason: reason.to_string(),
            }),
    }
}
