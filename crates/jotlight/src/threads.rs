//! The threads on which calls run.
//!
//! A thread that calls takes part in the work. Its first call makes a pool of as many threads as it
//! asks for, and the caller is one of them. If a call asks for another number, or its thread has no
//! pool, a shared pool works, and the caller waits. Later calls reuse all pools.

use std::cell::OnceCell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{Thread, available_parallelism, current, park_timeout};

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::{Error, Result};
use crate::interrupt::{Flag, OwnWork, TIME_BETWEEN_QUESTIONS, Wait};

/// The shared pools that wait for another call, in the order of their last use. They are kept because
/// starting threads takes longer than the work on a small image.
static IDLE_POOLS: Mutex<Vec<Pool>> = Mutex::new(Vec::new());

const MAX_IDLE_POOLS: usize = 4;

/// The maximum number of threads of a pool. It exceeds the number of cores of any processor.
const MAX_THREADS: usize = 1024;

/// The maximum numbers of calling threads that own a pool of one thread, and of several. When a calling
/// thread ends, about 3 KiB per thread of its pool remain allocated.
const MAX_OWN_POOLS: [usize; 2] = [64, 4];

/// The numbers of calling threads that have received pools of one and of several threads.
static OWN_POOLS: [AtomicUsize; 2] = [AtomicUsize::new(0), AtomicUsize::new(0)];

/// The number of cores that the process had at its first call, or 0 before it.
static CORES: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// The pool to which a calling thread belongs. A thread cannot leave its pool.
    static OWN_POOL: OnceCell<OwnPool> = const { OnceCell::new() };
}

/// A pool to which the calling thread belongs.
struct OwnPool {
    process: u32,
    threads: usize,
    /// None while the pool is dropped.
    workers: Option<ThreadPool>,
}

impl OwnPool {
    /// Return a pool of the current thread and of `threads - 1` others.
    fn new(threads: usize) -> Option<Self> {
        if rayon::current_thread_index().is_some() {
            // A thread of another pool of the program cannot belong to this one.
            return None;
        }
        let kind = usize::from(threads > 1);
        let is_left = |pools| (pools < MAX_OWN_POOLS[kind]).then_some(pools + 1);
        OWN_POOLS[kind]
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, is_left)
            .ok()?;
        let builder = pool_builder(threads, &Flag::of_thread()).use_current_thread();
        Some(Self {
            process: std::process::id(),
            threads,
            workers: Some(builder.build().ok()?),
        })
    }

    /// Return the pool if calls with this number of threads can use it.
    ///
    /// A fork does not copy threads, so in a child process only the caller remains of the pool.
    fn for_threads(&self, threads: usize) -> Option<&ThreadPool> {
        let serves = threads == 1 || self.process == std::process::id();
        self.workers
            .as_ref()
            .filter(|_| self.threads == threads && serves)
    }
}

impl Drop for OwnPool {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // The threads are missing in a forked child, and may have held locks. So the pool is not
            // ended.
            std::mem::forget(self.workers.take());
        }
    }
}

/// Work that writes its result where its owner finds it.
type Work<'a> = &'a mut (dyn FnMut() + Send);

/// A pool of threads.
struct Pool {
    /// The process that owns the threads. A fork does not copy threads, so a child process cannot
    /// use its parent's pools.
    process: u32,
    threads: usize,
    workers: ThreadPool,
    /// The flag that interrupts the work of these threads.
    interrupt: Flag,
}

/// Run `work` on `threads` threads and return its result. `None` means one thread for each core that
/// the process had at its first call.
///
/// The calling thread may become a member of a pool of rayon for the rest of its life. From then on,
/// its own parallel iterators run on these threads, also outside of this function. If your program has
/// its own pool, call the functions of this crate in that pool, without this one: they run on the pool
/// of their caller.
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
/// The calling thread asks `is_interrupted` every 50 ms, while it works or waits for a shared pool. If
/// it returns true, the functions of this crate end early. `work` should consist of calls of such
/// functions.
///
/// # Errors
/// [`Error::Interrupted`] if `is_interrupted` returned true, else the errors of [`install`] and of
/// `work`.
pub fn install_interruptible<R: Send>(
    threads: Option<usize>,
    is_interrupted: fn() -> bool,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    let threads = threads.unwrap_or_else(cores);
    if !(1..=MAX_THREADS).contains(&threads) {
        let expected = format!("at least 1 and at most {MAX_THREADS}");
        return Err(Error::range("threads", expected, threads));
    }
    run_once(work, |work| {
        OWN_POOL.with(|own| {
            if let Some(pool) = own_pool(own, threads)
                && let Some(own_work) = OwnWork::begin(is_interrupted)
            {
                pool.install(work);
                return own_work.end(Ok(()));
            }
            run_in_pool(threads, is_interrupted, work)
        })
    })
}

/// Run `work` on the calling thread as [`install_interruptible`] does. It must not use rayon.
///
/// # Errors
/// Those of [`install_interruptible`].
pub fn install_alone<R: Send>(
    is_interrupted: fn() -> bool,
    work: impl FnOnce() -> Result<R> + Send,
) -> Result<R> {
    let Some(own_work) = OwnWork::begin(is_interrupted) else {
        return run_once(work, |work| run_in_pool(1, is_interrupted, work));
    };
    let result = work();
    own_work.end(result)
}

/// Run `work` by `runner`, which calls it once, and return its result or the error of `runner`.
///
/// So the rest of this module is compiled once, and not for each kind of work.
fn run_once<R: Send>(
    work: impl FnOnce() -> Result<R> + Send,
    runner: impl FnOnce(Work<'_>) -> Result<()>,
) -> Result<R> {
    let (mut work, mut result) = (Some(work), Err(Error::Interrupted));
    runner(&mut || {
        if let Some(work) = work.take() {
            result = work();
        }
    })?;
    result
}

/// Return the number of cores that the process had at its first call.
fn cores() -> usize {
    // The question to the system takes longer than the work on a small image.
    let known = CORES.load(Ordering::Relaxed);
    if known > 0 {
        return known;
    }
    let cores = available_parallelism().map_or(1, usize::from);
    CORES.store(cores, Ordering::Relaxed);
    cores
}

/// Return the pool of the calling thread if it has this number of threads. The first call makes it.
fn own_pool(own: &OnceCell<OwnPool>, threads: usize) -> Option<&ThreadPool> {
    if own.get().is_none() {
        // This is the only thread that sets the cell, so it is still empty.
        let _ = own.set(OwnPool::new(threads)?);
    }
    own.get()?.for_threads(threads)
}

fn run_in_pool(threads: usize, is_interrupted: fn() -> bool, work: Work<'_>) -> Result<()> {
    let pool = match take_idle_pool(threads) {
        Some(pool) => pool,
        None => start_pool(threads)?,
    };
    let _wait = Wait::begin();
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
    fn run(&self, is_interrupted: fn() -> bool, work: Work<'_>) -> Result<()> {
        let is_done = Arc::new(AtomicBool::new(false));
        self.workers.in_place_scope(|scope| {
            let end = EndOfWork(Arc::clone(&is_done), current());
            scope.spawn(|_| {
                let _end = end;
                work();
            });
            // The wait at the end of the scope could start long jobs of the caller's own pool, so it
            // begins after the work.
            let mut is_raised = false;
            while !is_done.load(Ordering::Acquire) {
                park_timeout(TIME_BETWEEN_QUESTIONS);
                if !is_raised && !is_done.load(Ordering::Acquire) && is_interrupted() {
                    self.interrupt.raise();
                    is_raised = true;
                }
            }
        });
        if self.interrupt.lower() {
            return Err(Error::Interrupted);
        }
        Ok(())
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
    let workers = pool_builder(threads, &interrupt)
        .build()
        .map_err(|reason| Error::Threads {
            threads,
            reason: reason.to_string(),
        })?;
    Ok(Pool {
        process: std::process::id(),
        threads,
        workers,
        interrupt,
    })
}

/// Return a builder of a pool whose new threads have a flag.
fn pool_builder(threads: usize, interrupt: &Flag) -> ThreadPoolBuilder {
    let flag = interrupt.clone();
    ThreadPoolBuilder::new()
        .num_threads(threads)
        .start_handler(move |_| flag.attach())
}

#[cfg(test)]
mod tests {
    use std::thread::sleep;
    use std::time::Duration;

    use rayon::prelude::*;

    use super::*;
    use crate::interrupt;

    static QUESTIONS: AtomicUsize = AtomicUsize::new(0);

    /// Make an interrupted call, as a signal handler of Python may do.
    fn call_in_question() -> bool {
        if QUESTIONS.fetch_add(1, Ordering::Relaxed) == 0 {
            let slow_to_end = || {
                sleep(10 * TIME_BETWEEN_QUESTIONS);
                Ok(())
            };
            let result = install_interruptible(Some(1), || true, slow_to_end);
            assert!(matches!(result, Err(Error::Interrupted)));
            assert_eq!(QUESTIONS.load(Ordering::Relaxed), 1);
        }
        false
    }

    /// The work of the outer call has parts that the caller could run while it waits.
    #[test]
    fn a_call_asks_nothing_while_its_question_makes_another_call() {
        let run_part = |_| {
            sleep(Duration::from_millis(2));
            assert!(!interrupt::is_requested());
        };
        let work = || {
            (0..500).into_par_iter().for_each(run_part);
            Ok(())
        };
        let result = install_interruptible(Some(1), call_in_question, work);
        assert!(result.is_ok());
        assert!(QUESTIONS.load(Ordering::Relaxed) > 1);
    }
}
