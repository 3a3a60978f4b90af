//! How many threads a call uses.

use std::sync::{Arc, Mutex, PoisonError};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};

/// The threads of the last call, since starting them takes longer than a small picture.
static POOL: Mutex<Option<Pool>> = Mutex::new(None);

struct Pool {
    /// Threads do not survive a fork: a child needs its own.
    process: u32,
    threads: usize,
    workers: Arc<ThreadPool>,
}

/// Runs `work` on `threads` threads, or on all of the machine's when `threads` is `None`.
///
/// # Errors
/// [`Error::Range`] for zero threads, [`Error::Threads`] when the pool cannot be started.
pub fn install<R: Send>(threads: Option<usize>, work: impl FnOnce() -> R + Send) -> Result<R> {
    let threads = threads.unwrap_or_else(rayon::current_num_threads);
    if threads == 0 {
        return Err(Error::range("threads", "at least 1", 0));
    }
    Ok(pool_of(threads)?.install(work))
}

fn pool_of(threads: usize) -> Result<Arc<ThreadPool>> {
    let process = std::process::id();
    let mut last = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(last) = &*last
        && (last.process, last.threads) == (process, threads)
    {
        return Ok(Arc::clone(&last.workers));
    }
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|reason| Error::Threads {
            threads,
            reason: reason.to_string(),
        })?;
    let pool = Arc::new(pool);
    let former = last.replace(Pool {
        process,
        threads,
        workers: Arc::clone(&pool),
    });
    // What belongs to the parent of a fork has no threads here that could be told to stop.
    if let Some(former) = former
        && former.process != process
    {
        std::mem::forget(former);
    }
    Ok(pool)
}
