//! The interruption of calls that run in [`crate::threads`], for example by Ctrl-C.
//!
//! Each pool of threads has a flag. Long loops ask [`is_requested`] and skip the rest of their work
//! if the flag of their pool is raised. The call then returns [`crate::error::Error::Interrupted`],
//! so that nobody uses the incomplete result.

use std::cell::OnceCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// The number of raised flags. It is nearly always 0. Reading it takes less time than finding the
/// flag of the thread, so loops may ask often.
static RAISED_FLAGS: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// The flag of the pool to which the thread belongs.
    static FLAG: OnceCell<Arc<AtomicBool>> = const { OnceCell::new() };
}

/// The flag of a pool of threads.
#[derive(Clone, Default)]
pub(crate) struct Flag(Arc<AtomicBool>);

impl Flag {
    /// Make this the flag of the current thread.
    pub fn attach(&self) {
        // A thread belongs to one pool, so its flag is set only once.
        let _ = FLAG.with(|flag| flag.set(Arc::clone(&self.0)));
    }

    pub fn raise(&self) {
        if !self.0.swap(true, Ordering::Relaxed) {
            RAISED_FLAGS.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Lower the flag, and return whether it was raised.
    pub fn lower(&self) -> bool {
        let was_raised = self.0.swap(false, Ordering::Relaxed);
        if was_raised {
            RAISED_FLAGS.fetch_sub(1, Ordering::Relaxed);
        }
        was_raised
    }
}

/// Return whether the current call should end early.
///
/// Loops ask this at least every 100 milliseconds, and at most every 100 nanoseconds.
#[inline]
pub(crate) fn is_requested() -> bool {
    RAISED_FLAGS.load(Ordering::Relaxed) != 0 && is_flag_raised()
}

#[cold]
fn is_flag_raised() -> bool {
    FLAG.with(|flag| flag.get().is_some_and(|flag| flag.load(Ordering::Relaxed)))
}
