//! How many threads a call uses.

use std::sync::Mutex;
use std::thread::available_parallelism;

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};

/// Threads that wait for a further call, since starting them takes longer than a small picture.
static WAITING: Mutex<Vec<Pool>> = Mutex::new(Vec::new());

/// Pools that wait at most.
const MOST: usize = 4;

struct Pool {
    /// Threads do not survive a fork: a child needs its own.
    process: u32,
    threads: usize,
    workers: ThreadPool,
}

/// Runs `work` on `threads` threads, or on all of the machine's when `threads` is `None`. Calls at the same time have threads of their own.
///
/// # Errors
/// [`Error::Range`] for zero threads, [`Error::Threads`] when they cannot be started.
pub fn install<R: Send>(threads: Option<usize>, work: impl FnOnce() -> R + Send) -> Result<R> {
    let threads = match threads {
        Some(0) => return Err(Error::range("threads", "at least 1", 0)),
        Some(threads) => threads,
        None => available_parallelism().map_or(1, usize::from),
    };
    let pool = match waiting(threads) {
        Some(pool) => pool,
        None => started(threads)?,
    };
    let result = pool.workers.install(work);
    // Where another call looks at them just now, or in the child of a fork did so for ever, these threads end.
    if let Ok(mut pools) = WAITING.try_lock()
        && pools.len() < MOST
    {
        pools.push(pool);
    }
    Ok(result)
}

/// Takes a pool of that many threads from those that wait.
fn waiting(threads: usize) -> Option<Pool> {
    let process = std::process::id();
    let mut pools = WAITING.try_lock().ok()?;
    // What belongs to the parent of a fork has no threads here that could be told to end.
    pools
        .extract_if(.., |pool| pool.process != process)
        .for_each(std::mem::forget);
    let place = pools.iter().position(|pool| pool.threads == threads)?;
    Some(pools.swap_remove(place))
}

fn started(threads: usize) -> Result<Pool> {
    let workers = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|reason| Error::Threads {
            threads,
            reason: reason.to_string(),
        })?;
    Ok(Pool {
        process: std::process::id(),
        threads,
        workers,
    })
}
