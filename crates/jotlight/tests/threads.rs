//! The threads of calls.

use std::thread::{self, ThreadId, current};

use jotlight::threads;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Return the threads of a call.
fn workers(number: usize) -> Result<Vec<ThreadId>> {
    Ok(threads::install(Some(number), || {
        rayon::broadcast(|_| current().id())
    })?)
}

/// Few threads receive pools of their own, so the order of the tests matters.
#[test]
fn calls_use_the_calling_thread_and_others() -> Result<()> {
    callers_belong_to_pools_as_large_as_those_of_their_first_calls()?;
    work_that_uses_no_other_thread_runs_in_the_calling_thread()?;
    threads_of_other_pools_can_call()?;
    // These use up the pools.
    concurrent_calls_have_threads_of_their_own()?;
    many_threads_can_call();
    #[cfg(target_os = "linux")]
    pools_do_not_accumulate()?;
    Ok(())
}

fn callers_belong_to_pools_as_large_as_those_of_their_first_calls() -> Result<()> {
    for (first, other) in [(1, 2), (2, 1), (3, 2)] {
        let of_calls = thread::spawn(move || {
            let caller = current().id();
            for _ in 0..3 {
                let own = workers(first).map_err(|error| error.to_string())?;
                assert_eq!(own.len(), first);
                assert!(own.contains(&caller), "{first} threads");
                let shared = workers(other).map_err(|error| error.to_string())?;
                assert_eq!(shared.len(), other);
                assert!(!shared.contains(&caller), "{other} threads after {first}");
            }
            Ok::<_, String>(())
        });
        of_calls.join().map_err(|_| "the thread panicked")??;
    }
    Ok(())
}

fn work_that_uses_no_other_thread_runs_in_the_calling_thread() -> Result<()> {
    let of_calls = thread::spawn(|| {
        for _ in 0..2 {
            let worker = threads::install_alone(|| false, || Ok(current().id()));
            assert_eq!(worker.map_err(|error| error.to_string())?, current().id());
            workers(1).map_err(|error| error.to_string())?;
        }
        Ok::<_, String>(())
    });
    of_calls.join().map_err(|_| "the thread panicked")??;
    Ok(())
}

fn concurrent_calls_have_threads_of_their_own() -> Result<()> {
    let call = || workers(2).map_err(|error| error.to_string());
    let callers: Vec<_> = (0..8)
        .map(|_| thread::spawn(move || (call(), call())))
        .collect();
    for caller in callers {
        let (first, second) = caller.join().map_err(|_| "the thread panicked")?;
        assert_eq!((first?.len(), second?.len()), (2, 2));
    }
    Ok(())
}

#[cfg(target_os = "linux")]
fn pools_do_not_accumulate() -> Result<()> {
    let number = || Ok::<_, std::io::Error>(std::fs::read_dir("/proc/self/task")?.count());
    for threads in 2..40 {
        threads::install(Some(threads), || ())?;
    }
    // The threads of a pool that is dropped may still be ending.
    for _ in 0..100 {
        if number()? <= 4 * 40 + 10 {
            return Ok(());
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    Err(format!("{} threads", number()?).into())
}

fn many_threads_can_call() {
    for _ in 0..200 {
        let result = std::thread::spawn(|| threads::install(Some(1), || 7)).join();
        assert!(matches!(result, Ok(Ok(7))));
    }
}

fn threads_of_other_pools_can_call() -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build()?;
    for _ in 0..100 {
        let result = pool.install(|| threads::install(Some(2), || rayon::broadcast(|_| 7)));
        assert_eq!(result?, [7, 7]);
    }
    // They have not taken the places of threads that can have a pool of their own.
    let own = thread::spawn(|| {
        (
            current().id(),
            workers(1).map_err(|error| error.to_string()),
        )
    });
    let (caller, workers) = own.join().map_err(|_| "the thread panicked")?;
    assert_eq!(workers?, [caller]);
    Ok(())
}
