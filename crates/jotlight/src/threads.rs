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
    #[cfg(target_os = "linux")]
    ids: Vec<rustix::thread::Pid>,
}

#[cfg(target_os = "linux")]
impl Pool {
    /// Gives each thread a share of the caller's cores, as many shares as there are threads or cores. Else two that wake together may be put on one
    /// core: where a virtual machine's sleeping cores do not look free, many a call ends before the system has parted them.
    fn spread(&self) {
        use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

        // Of the caller, who may have been kept to some of them since the last call.
        let Ok(allowed) = sched_getaffinity(None) else {
            return;
        };
        let cores = (0..CpuSet::MAX_CPU).filter(|&core| allowed.is_set(core));
        let mut cores: Vec<_> = cores.collect();
        let shares = self.threads.min(cores.len()).max(1);
        // The first thread, which works alone where there is little to do, has the caller's core, for the caller sleeps: other callers have others.
        let here = sched_getcpu();
        let here = cores.iter().position(|&core| core == here);
        cores.rotate_left(here.unwrap_or(0));
        for (index, &id) in self.ids.iter().enumerate() {
            let mut share = CpuSet::new();
            for &core in cores.iter().skip(index % shares).step_by(shares) {
                share.set(core);
            }
            // Where the system forbids it, the threads do without.
            let _ = sched_setaffinity(Some(id), &share);
        }
    }
}

/// Runs `work` on `threads` threads, or on all of the machine's when `threads` is `None`. Calls at the same time have threads of their own; `work` itself is not to call it.
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
    #[cfg(target_os = "linux")]
    pool.spread();
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
        #[cfg(target_os = "linux")]
        ids: workers.broadcast(|_| rustix::thread::gettid()),
        process: std::process::id(),
        threads,
        workers,
    })
}
