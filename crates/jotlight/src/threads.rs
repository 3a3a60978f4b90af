//! The number of threads of a call, and the pools of threads that calls reuse.

use std::sync::Mutex;
use std::thread::available_parallelism;

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};

/// Pools that wait for another call. Starting threads takes longer than the work on a small image.
static IDLE_POOLS: Mutex<Vec<Pool>> = Mutex::new(Vec::new());

const MAX_IDLE_POOLS: usize = 4;

struct Pool {
    /// The process that owns the threads. Threads do not survive a fork: a child needs its own.
    process: u32,
    threads: usize,
    workers: ThreadPool,
    #[cfg(target_os = "linux")]
    ids: Vec<rustix::thread::Pid>,
}

#[cfg(target_os = "linux")]
impl Pool {
    /// Restrict each thread to its own part of the caller's cores.
    ///
    /// The cores are divided into as many parts as there are threads or cores, whichever is fewer.
    /// Without this, two threads that wake together may share a core: on a virtual machine,
    /// sleeping cores may look busy, and many calls end before the system separates the threads.
    fn pin_to_cores(&self) {
        use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

        // The caller's cores may have changed since the last call.
        let Ok(allowed) = sched_getaffinity(None) else {
            return;
        };
        let cores = (0..CpuSet::MAX_CPU).filter(|&core| allowed.is_set(core));
        let mut cores: Vec<_> = cores.collect();
        let parts = self.threads.min(cores.len()).max(1);
        // The first thread works alone when there is little to do. It receives the core of the
        // caller, which sleeps during the call. Concurrent callers have different cores.
        let caller_core = sched_getcpu();
        let caller_index = cores.iter().position(|&core| core == caller_core);
        cores.rotate_left(caller_index.unwrap_or(0));
        for (index, &id) in self.ids.iter().enumerate() {
            let mut part = CpuSet::new();
            for &core in cores.iter().skip(index % parts).step_by(parts) {
                part.set(core);
            }
            // Where the system forbids it, the threads run without a restriction.
            let _ = sched_setaffinity(Some(id), &part);
        }
    }
}

/// Run `work` on `threads` threads, or on as many as the machine has cores for `None`.
///
/// Concurrent calls use separate threads. `work` must not call this function.
///
/// # Errors
/// [`Error::Range`] for zero threads, [`Error::Threads`] when the threads cannot be started.
pub fn install<R: Send>(threads: Option<usize>, work: impl FnOnce() -> R + Send) -> Result<R> {
    let threads = match threads {
        Some(0) => return Err(Error::range("threads", "at least 1", 0)),
        Some(threads) => threads,
        None => available_parallelism().map_or(1, usize::from),
    };
    let pool = match take_idle_pool(threads) {
        Some(pool) => pool,
        None => start_pool(threads)?,
    };
    #[cfg(target_os = "linux")]
    pool.pin_to_cores();
    let result = pool.workers.install(work);
    // The lock may be taken: briefly by another call, or forever in the child of a fork. The
    // threads of this pool then end.
    if let Ok(mut pools) = IDLE_POOLS.try_lock()
        && pools.len() < MAX_IDLE_POOLS
    {
        pools.push(pool);
    }
    Ok(result)
}

/// Remove an idle pool of `threads` threads from the list and return it.
fn take_idle_pool(threads: usize) -> Option<Pool> {
    let process = std::process::id();
    let mut pools = IDLE_POOLS.try_lock().ok()?;
    // In the child of a fork, the parent's pools have no threads. Dropping them would wait forever.
    pools
        .extract_if(.., |pool| pool.process != process)
        .for_each(std::mem::forget);
    let index = pools.iter().position(|pool| pool.threads == threads)?;
    Some(pools.swap_remove(index))
}

fn start_pool(threads: usize) -> Result<Pool> {
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
