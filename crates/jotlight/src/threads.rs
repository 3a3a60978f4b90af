//! The pools of threads on which calls run. Later calls reuse them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{Thread, available_parallelism, current, park_timeout};
use std::time::Duration;

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};
use crate::interrupt::Flag;

/// The pools that wait for another call. They are kept because starting threads takes longer than
/// the work on a small image.
static IDLE_POOLS: Mutex<Vec<Pool>> = Mutex::new(Vec::new());

const MAX_IDLE_POOLS: usize = 4;

/// The maximum number of threads of a pool. It exceeds the number of cores of any processor.
const MAX_THREADS: usize = 1024;

/// The time between two questions whether a call should be interrupted.
const TIME_BETWEEN_QUESTIONS: Duration = Duration::from_millis(50);

/// A pool of threads.
struct Pool {
    /// The process that owns the threads. A fork does not copy threads, so a child process cannot
    /// use its parent's pools.
    process: u32,
    threads: usize,
    workers: ThreadPool,
    /// The flag that interrupts the work of these threads.
    interrupt: Flag,
    #[cfg(target_os = "linux")]
    ids: Vec<rustix::thread::Pid>,
}

#[cfg(target_os = "linux")]
impl Pool {
    /// Restrict each thread to its own part of the caller's cores.
    ///
    /// The number of parts is the number of threads or the number of cores, whichever is smaller.
    /// Without this restriction, two threads that wake at the same time may share a core. On a
    /// virtual machine, idle cores may look busy, and many calls end before the operating system
    /// moves one of the threads to another core.
    fn pin_to_cores(&self) {
        use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

        // The caller's cores may have changed since the last call.
        let Ok(allowed) = sched_getaffinity(None) else {
            return;
        };
        let cores = (0..CpuSet::MAX_CPU).filter(|&core| allowed.is_set(core));
        let mut cores: Vec<_> = cores.collect();
        let parts = self.threads.min(cores.len()).max(1);
        // If there is little to do, the first thread works alone. It receives the core of the
        // caller, because the caller sleeps during the call. Concurrent callers run on different
        // cores, so their first threads do too.
        let caller_core = sched_getcpu();
        let caller_index = cores.iter().position(|&core| core == caller_core);
        cores.rotate_left(caller_index.unwrap_or(0));
        for (index, &id) in self.ids.iter().enumerate() {
            let mut part = CpuSet::new();
            for &core in cores.iter().skip(index % parts).step_by(parts) {
                part.set(core);
            }
            // If the system forbids the restriction, the threads run without it.
            let _ = sched_setaffinity(Some(id), &part);
        }
    }
}

/// Run `work` on `threads` threads and return its result. `None` means one thread per core.
///
/// Concurrent calls use separate threads. `work` must not call this function.
///
/// # Errors
/// [`Error::Range`] for a number of threads that is not 1 to 1024, [`Error::Threads`] if the system
/// cannot start the threads.
pub fn install<R: Send>(threads: Option<usize>, work: impl FnOnce() -> R + Send) -> Result<R> {
    install_interruptible(threads, || false, || Ok(work()))
}

/// Run `work` as [`install`] does, until `is_interrupted` returns true.
///
/// The calling thread asks `is_interrupted` every 50 ms while the other threads work. If it returns
/// true, the functions of this crate end early. `work` should consist of calls of such functions.
///
/// # Errors
/// [`Error::Interrupted`] if `is_interrupted` returned true, else the errors of [`install`] and of
/// `work`.
pub fn install_interruptible<R: Send>(
    threads: Option<usize>,
    is_interrupted: impl FnMut() -> bool,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    let threads = threads.unwrap_or_else(|| available_parallelism().map_or(1, usize::from));
    if !(1..=MAX_THREADS).contains(&threads) {
        let expected = format!("at least 1 and at most {MAX_THREADS}");
        return Err(Error::range("threads", expected, threads));
    }
    let pool = match take_idle_pool(threads) {
        Some(pool) => pool,
        None => start_pool(threads)?,
    };
    #[cfg(target_os = "linux")]
    pool.pin_to_cores();
    let result = pool.run(is_interrupted, work);
    // Another call may hold the lock, and after a fork the child may never get it. In both cases
    // the pool is dropped, and its threads end.
    if let Ok(mut pools) = IDLE_POOLS.try_lock()
        && pools.len() < MAX_IDLE_POOLS
    {
        pools.push(pool);
    }
    result
}

impl Pool {
    fn run<R: Send>(
        &self,
        mut is_interrupted: impl FnMut() -> bool,
        work: impl FnOnce() -> Result<R> + Send,
    ) -> Result<R> {
        let is_done = Arc::new(AtomicBool::new(false));
        let mut result = Err(Error::Interrupted);
        self.workers.in_place_scope(|scope| {
            let end = EndOfWork(Arc::clone(&is_done), current());
            scope.spawn(|_| {
                let _end = end;
                result = work();
            });
            let is_done = || is_done.load(Ordering::Acquire);
            while !is_done() {
                park_timeout(TIME_BETWEEN_QUESTIONS);
                if !is_done() && is_interrupted() {
                    self.interrupt.raise();
                    break;
                }
            }
        });
        if self.interrupt.lower() {
            return Err(Error::Interrupted);
        }
        result
    }
}

/// A guard that wakes the calling thread after the work, even if the work panics.
struct EndOfWork(Arc<AtomicBool>, Thread);

impl Drop for EndOfWork {
    fn drop(&mut self) {
        let Self(is_done, caller) = self;
        let (is_done, caller) = (Arc::clone(is_done), caller.clone());
        // This runs after the scope has ended. An earlier wake-up would let the caller run on the
        // core of this thread, wait for the end of the scope, and switch threads twice more.
        rayon::spawn(move || {
            is_done.store(true, Ordering::Release);
            caller.unpark();
        });
    }
}

/// Remove an idle pool of `threads` threads from the list and return it.
fn take_idle_pool(threads: usize) -> Option<Pool> {
    let process = std::process::id();
    let mut pools = IDLE_POOLS.try_lock().ok()?;
    // In a forked child, the pools of the parent have no threads, so dropping them would block
    // forever.
    pools
        .extract_if(.., |pool| pool.process != process)
        .for_each(std::mem::forget);
    let index = pools.iter().position(|pool| pool.threads == threads)?;
    Some(pools.swap_remove(index))
}

fn start_pool(threads: usize) -> Result<Pool> {
    let interrupt = Flag::default();
    let flag = interrupt.clone();
    let workers = ThreadPoolBuilder::new()
        .num_threads(threads)
        .start_handler(move |_| flag.attach())
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
        interrupt,
    })
}
