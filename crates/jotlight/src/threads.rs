//! The threads on which calls run.
//!
//! With one thread, the calling thread does the work itself. With more, a pool does, and the calling
//! thread waits. Later calls reuse the pools.

use std::cell::OnceCell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread::{Thread, available_parallelism, current, park_timeout};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};
use crate::interrupt::{Flag, OwnWork, TIME_BETWEEN_QUESTIONS};

/// The pools that wait for another call, in the order of their last use. They are kept because
/// starting threads takes longer than the work on a small image.
static IDLE_POOLS: Mutex<Vec<Pool>> = Mutex::new(Vec::new());

const MAX_IDLE_POOLS: usize = 4;

/// The maximum number of threads of a pool. It exceeds the number of cores of any processor.
const MAX_THREADS: usize = 1024;

/// The maximum number of threads that may work for their own calls. Memory of about 3 KiB remains
/// allocated for each of them when it ends. The calls of further threads use pools of one thread.
const MAX_OWN_WORKERS: usize = 64;

/// The number of threads that may work for their own calls.
static OWN_WORKERS: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// What the thread needs to work for its own calls. None if too many other threads do.
    static OWN_WORKER: OnceCell<Option<OwnWorker>> = const { OnceCell::new() };
}

/// A thread that works for its own calls, as the only thread of a pool.
struct OwnWorker {
    pool: ThreadPool,
    interrupt: Flag,
}

impl OwnWorker {
    /// Return the current thread as a worker.
    fn new() -> Option<Self> {
        let is_left = |workers| (workers < MAX_OWN_WORKERS).then_some(workers + 1);
        OWN_WORKERS
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, is_left)
            .ok()?;
        let builder = ThreadPoolBuilder::new().num_threads(1);
        // A thread of another pool of the program cannot belong to this one.
        let pool = builder.use_current_thread().build().ok()?;
        let interrupt = Flag::default();
        interrupt.attach();
        Some(Self { pool, interrupt })
    }

    fn run<R: Send>(
        &self,
        is_interrupted: fn() -> bool,
        work: impl FnOnce() -> Result<R> + Send,
    ) -> Result<R> {
        let own_work = OwnWork::begin(is_interrupted);
        let result = self.pool.install(work);
        drop(own_work);
        if self.interrupt.lower() {
            return Err(Error::Interrupted);
        }
        result
    }
}

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
    /// Restrict each thread to its own part of the caller's cores, if the environment variable
    /// `JOTLIGHT_BIND` is 1.
    ///
    /// The number of parts is the number of threads or the number of cores, whichever is smaller.
    /// Without this restriction, two threads that wake at the same time may share a core. On a
    /// virtual machine, idle cores may look busy, and many calls end before the operating system
    /// moves one of the threads to another core. But it takes system calls, and it is harmful if
    /// other programs use the same cores.
    fn pin_to_cores(&self) {
        use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

        static BIND: OnceLock<bool> = OnceLock::new();
        if !BIND.get_or_init(|| std::env::var_os("JOTLIGHT_BIND").is_some_and(|bind| bind == "1")) {
            return;
        }
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

/// Run `work` on `threads` threads and return its result. `None` means one thread for each core that
/// the process had at its first call.
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
/// The calling thread asks `is_interrupted` every 50 ms, while it works or waits. If it returns
/// true, the functions of this crate end early. `work` should consist of calls of such functions.
///
/// # Errors
/// [`Error::Interrupted`] if `is_interrupted` returned true, else the errors of [`install`] and of
/// `work`.
pub fn install_interruptible<R: Send>(
    threads: Option<usize>,
    is_interrupted: fn() -> bool,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    // The question to the system takes longer than the work on a small image.
    static CORES: OnceLock<usize> = OnceLock::new();
    let cores = || *CORES.get_or_init(|| available_parallelism().map_or(1, usize::from));
    let threads = threads.unwrap_or_else(cores);
    if !(1..=MAX_THREADS).contains(&threads) {
        let expected = format!("at least 1 and at most {MAX_THREADS}");
        return Err(Error::range("threads", expected, threads));
    }
    if threads > 1 {
        return run_in_pool(threads, is_interrupted, work);
    }
    OWN_WORKER.with(|worker| match worker.get_or_init(OwnWorker::new) {
        Some(worker) => worker.run(is_interrupted, work),
        None => run_in_pool(threads, is_interrupted, work),
    })
}

fn run_in_pool<R: Send>(
    threads: usize,
    is_interrupted: fn() -> bool,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    let pool = match take_idle_pool(threads) {
        Some(pool) => pool,
        None => start_pool(threads)?,
    };
    #[cfg(target_os = "linux")]
    pool.pin_to_cores();
    let result = pool.run(is_interrupted, work);
    // Another call may hold the lock, and after a fork the child may never get it. In both cases
    // the pool is dropped, and its threads end.
    if let Ok(mut pools) = IDLE_POOLS.try_lock() {
        if pools.len() >= MAX_IDLE_POOLS {
            pools.remove(0);
        }
        pools.push(pool);
    }
    result
}

impl Pool {
    fn run<R: Send>(
        &self,
        is_interrupted: fn() -> bool,
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
    Some(pools.remove(index))
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
