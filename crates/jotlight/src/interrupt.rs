//! The interruption of calls that run in [`crate::threads`], for example by Ctrl-C.
//!
//! Each pool of threads has a flag. Long loops call [`is_requested`] and skip the rest of their work
//! if the flag of their pool is set. The call then returns [`crate::error::Error::Interrupted`], so
//! that nobody uses the incomplete result. If the calling thread works itself, its loops also call
//! the function that reports interruptions.

use std::cell::{Cell, OnceCell};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::error::{Error, Result};

/// The time between two questions whether a call should be interrupted.
pub(crate) const TIME_BETWEEN_QUESTIONS: Duration = Duration::from_millis(50);

/// The number of raised flags, and of calling threads that work themselves. Reading it takes less
/// time than finding the flag of the thread, so loops may ask often.
static CAUSES: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// The flag of the pool to which the thread belongs.
    static FLAG: OnceCell<Arc<AtomicBool>> = const { OnceCell::new() };
    /// The question of the call for which this thread works itself.
    static QUESTION: Cell<Option<Question>> = const { Cell::new(None) };
}

/// The number of times that a loop that asks often does not look at the clock.
const SKIPPED_LOOKS: u32 = 16;
/// A loop asks often if the time since its last look at the clock is shorter.
const SHORT_TIME: Duration = Duration::from_micros(100);

/// A function that returns whether the call is interrupted, and when to call it again.
#[derive(Clone, Copy)]
struct Question {
    ask: fn() -> bool,
    due: Instant,
    /// The time of the last look at the clock.
    last: Instant,
    /// The number of looks to skip.
    skipped: u32,
}

/// The time during which the current thread works itself for a call.
pub(crate) struct OwnWork(Flag);

impl OwnWork {
    /// Begin to call `ask` from time to time, or return None if the thread works for a call already.
    ///
    /// `ask` may make such a call, for example in a signal handler of Python.
    pub fn begin(ask: fn() -> bool) -> Option<Self> {
        if QUESTION.get().is_some() {
            return None;
        }
        let last = Instant::now();
        QUESTION.set(Some(Question {
            ask,
            due: last + TIME_BETWEEN_QUESTIONS,
            last,
            skipped: 0,
        }));
        CAUSES.fetch_add(1, Ordering::Relaxed);
        Some(Self(Flag::of_thread()))
    }

    /// End the work, and return its result unless the call was interrupted.
    pub fn end<R>(self, result: Result<R>) -> Result<R> {
        if self.0.lower() {
            return Err(Error::Interrupted);
        }
        result
    }
}

impl Drop for OwnWork {
    fn drop(&mut self) {
        CAUSES.fetch_sub(1, Ordering::Relaxed);
        QUESTION.set(None);
        // After a panic, nobody has lowered it.
        self.0.lower();
    }
}

/// The time during which the current thread waits for another pool, although it works for a call.
///
/// Such a wait occurs if the question makes a call. The thread may run jobs of its own call meanwhile,
/// and those do not ask. Otherwise, one of them could ask after the interruption of the other call,
/// and its answer would replace the reason.
pub(crate) struct Wait(Option<Question>);

impl Wait {
    pub fn begin() -> Self {
        let question = QUESTION.get();
        let silent = |question| Question {
            ask: || false,
            ..question
        };
        QUESTION.set(question.map(silent));
        Self(question)
    }
}

impl Drop for Wait {
    fn drop(&mut self) {
        QUESTION.set(self.0);
    }
}

/// The flag of a pool of threads.
#[derive(Clone, Default)]
pub(crate) struct Flag(Arc<AtomicBool>);

impl Flag {
    /// Return the flag of the current thread, which receives a new one if it has none.
    pub fn of_thread() -> Self {
        FLAG.with(|flag| Self(Arc::clone(flag.get_or_init(Arc::default))))
    }

    /// Make this the flag of the current thread.
    pub fn attach(&self) {
        // A thread belongs to one pool, so its flag is set only once.
        let _ = FLAG.with(|flag| flag.set(Arc::clone(&self.0)));
    }

    pub fn raise(&self) {
        if !self.0.swap(true, Ordering::Relaxed) {
            CAUSES.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Lower the flag, and return whether it was raised.
    pub fn lower(&self) -> bool {
        let was_raised = self.0.swap(false, Ordering::Relaxed);
        if was_raised {
            CAUSES.fetch_sub(1, Ordering::Relaxed);
        }
        was_raised
    }
}

/// Return whether the current call should end early.
///
/// Loops ask this at least every 100 milliseconds, and at most every 100 nanoseconds.
#[inline]
pub(crate) fn is_requested() -> bool {
    CAUSES.load(Ordering::Relaxed) != 0 && (is_flag_raised() || is_interrupted())
}

#[inline(never)]
fn is_flag_raised() -> bool {
    FLAG.with(|flag| flag.get().is_some_and(|flag| flag.load(Ordering::Relaxed)))
}

/// Ask the question of the current call if it is due. If the call is interrupted, raise the flag of
/// the thread.
#[inline(never)]
fn is_interrupted() -> bool {
    let Some(mut question) = QUESTION.get() else {
        return false;
    };
    if question.skipped > 0 {
        question.skipped -= 1;
        QUESTION.set(Some(question));
        return false;
    }
    let now = Instant::now();
    if now - question.last < SHORT_TIME {
        question.skipped = SKIPPED_LOOKS;
    }
    question.last = now;
    let is_due = now >= question.due;
    if is_due {
        question.due = now + TIME_BETWEEN_QUESTIONS;
    }
    QUESTION.set(Some(question));
    let is_interrupted = is_due && (question.ask)();
    if is_interrupted {
        FLAG.with(|flag| flag.get().map(|flag| Flag(Arc::clone(flag)).raise()));
    }
    is_interrupted
}
