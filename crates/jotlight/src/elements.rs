//! Loops over the elements of arrays.
//!
//! A task has a fixed number of elements, so results are the same for any number of threads. The
//! loops end early if the call is interrupted.

use rayon::prelude::*;

use crate::interrupt;

/// The number of elements after which a task asks whether the call is interrupted.
const ELEMENTS_PER_QUESTION: usize = 1 << 6;

/// Write `value(i)` into each element i of `out`.
pub(crate) fn write<T: Send>(out: &mut [T], per_task: usize, value: impl Fn(usize) -> T + Sync) {
    let tasks = out.par_chunks_mut(per_task).enumerate();
    tasks.for_each(|(task, out)| {
        for (offset, out) in out.iter_mut().enumerate() {
            // Each task asks at its start, also one with fewer elements.
            if offset % ELEMENTS_PER_QUESTION == 0 && interrupt::is_requested() {
                return;
            }
            *out = value(task * per_task + offset);
        }
    });
}

/// Write into two arrays of the same length with `write(state, i, …)`. It receives the parts of the
/// arrays that begin with the element i. The tasks of a thread share a state.
pub(crate) fn write_pairs<State>(
    first: &mut [f64],
    second: &mut [f64],
    per_task: usize,
    state: impl Fn() -> State + Sync + Send,
    write: impl Fn(&mut State, usize, &mut [f64], &mut [f64]) + Sync + Send,
) {
    let tasks = first.par_chunks_mut(per_task);
    let tasks = tasks.zip(second.par_chunks_mut(per_task)).enumerate();
    tasks.for_each_init(state, |state, (task, (first, second))| {
        if !interrupt::is_requested() {
            write(state, task * per_task, first, second);
        }
    });
}

/// Return the sum of `term(i)` over `length` elements.
pub(crate) fn sum(length: usize, per_task: usize, term: impl Fn(usize) -> f64 + Sync) -> f64 {
    // Each task has its own sum, and these sums are added in order.
    let sums: Vec<f64> = (0..length.div_ceil(per_task))
        .into_par_iter()
        .map(|task| {
            if interrupt::is_requested() {
                return 0.0;
            }
            let end = length.min((task + 1) * per_task);
            (task * per_task..end).map(&term).sum()
        })
        .collect();
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn tasks_of_few_elements_end_early_too() {
        let (flag, calls) = (interrupt::Flag::default(), AtomicUsize::new(0));
        let own = flag.clone();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(2)
            .start_handler(move |_| own.attach())
            .build();
        let count = |_| calls.fetch_add(1, Ordering::Relaxed);
        let run = |per_task| {
            let mut out = [0; 256];
            let work = || write(&mut out, per_task, count);
            pool.as_ref().map(|pool| pool.install(work)).is_ok()
        };
        flag.raise();
        assert!([1, 16, 64, 100, 256].into_iter().all(run));
        flag.lower();
        assert_eq!(calls.load(Ordering::Relaxed), 0);
    }
}
