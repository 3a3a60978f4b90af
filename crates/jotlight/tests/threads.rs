//! The threads of calls, and the distribution of the caller's cores over the threads of a pool.
#![cfg(target_os = "linux")]

use std::error::Error;
use std::process::Command;

use jotlight::threads;
use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Return the cores that each of `number` threads may use.
fn cores_of_threads(number: usize) -> Result<Vec<CpuSet>> {
    let sets = threads::install(Some(number), || {
        rayon::broadcast(|_| sched_getaffinity(None))
    })?;
    Ok(sets.into_iter().collect::<rustix::io::Result<_>>()?)
}

#[test]
fn bound_threads_use_their_own_cores() -> Result<()> {
    let mut command = Command::new(std::env::current_exe()?);
    let command = command.args(["--ignored", "--test-threads", "1"]);
    assert!(command.env("JOTLIGHT_BIND", "1").status()?.success());
    Ok(())
}

#[test]
fn threads_are_not_bound_unless_the_user_asks_for_it() -> Result<()> {
    let allowed = cores(&sched_getaffinity(None)?);
    for threads in [1, 2, 3] {
        for part in cores_of_threads(threads)? {
            assert_eq!(cores(&part), allowed);
        }
    }
    Ok(())
}

#[test]
fn a_single_thread_is_the_calling_thread() -> Result<()> {
    let caller = std::thread::current().id();
    for _ in 0..3 {
        let worker = threads::install(Some(1), || std::thread::current().id())?;
        assert_eq!(worker, caller);
        let workers = threads::install(Some(2), || {
            rayon::broadcast(|_| std::thread::current().id())
        })?;
        assert!(workers.len() == 2 && !workers.contains(&caller));
    }
    Ok(())
}

#[test]
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

#[test]
fn many_threads_can_call() {
    for _ in 0..200 {
        let result = std::thread::spawn(|| threads::install(Some(1), || 7)).join();
        assert!(matches!(result, Ok(Ok(7))));
    }
}

fn cores(set: &CpuSet) -> Vec<usize> {
    let all = 0..CpuSet::MAX_CPU;
    all.filter(|&core| set.is_set(core)).collect()
}

#[test]
#[ignore = "`bound_threads_use_their_own_cores` runs it with JOTLIGHT_BIND=1"]
fn threads_divide_the_cores_evenly() -> Result<()> {
    let allowed = cores(&sched_getaffinity(None)?);
    let numbers = [2, 3, allowed.len()];
    for number in numbers
        .into_iter()
        .filter(|&n| (2..=allowed.len()).contains(&n))
    {
        let mut parts: Vec<_> = cores_of_threads(number)?.iter().map(cores).collect();
        let sizes = parts.iter().map(Vec::len);
        assert!(sizes.clone().max() <= sizes.min().map(|min| min + 1));
        parts.sort();
        let mut union = parts.concat();
        union.sort_unstable();
        assert_eq!(union, allowed, "{number} threads");
    }
    // With twice as many threads as cores, each core belongs to two threads.
    let parts = cores_of_threads(2 * allowed.len())?;
    for &core in &allowed {
        let threads = parts.iter().filter(|part| part.is_set(core));
        assert_eq!(threads.count(), 2, "core {core}");
    }
    Ok(())
}

#[test]
#[ignore = "`bound_threads_use_their_own_cores` runs it with JOTLIGHT_BIND=1"]
fn the_first_thread_receives_the_callers_core() -> Result<()> {
    let allowed = sched_getaffinity(None)?;
    let Some(&second) = cores(&allowed).get(1) else {
        return Ok(());
    };
    let mut one = CpuSet::new();
    one.set(second);
    let mut stayed = 0;
    let mut received = 0;
    for _ in 0..200 {
        // The caller moves to the second core, and mostly stays there.
        sched_setaffinity(None, &one)?;
        sched_setaffinity(None, &allowed)?;
        let core = sched_getcpu();
        let parts = cores_of_threads(2)?;
        // A caller that has moved may have done so before the pool read its core.
        if core == second && core == sched_getcpu() {
            stayed += 1;
            received += usize::from(parts[0].is_set(core));
        }
    }
    assert!(stayed > 0);
    assert!(received * 10 >= stayed * 9, "{received} of {stayed}");
    Ok(())
}

#[test]
#[ignore = "`bound_threads_use_their_own_cores` runs it with JOTLIGHT_BIND=1"]
fn threads_stay_within_the_cores_of_the_caller() -> Result<()> {
    let before = sched_getaffinity(None)?;
    let mut one = CpuSet::new();
    one.set(sched_getcpu());
    // All calls reuse the same idle threads.
    for allowed in [before, one, before] {
        sched_setaffinity(None, &allowed)?;
        for part in cores_of_threads(2)? {
            let part = cores(&part);
            assert!(!part.is_empty());
            assert!(part.iter().all(|&core| allowed.is_set(core)));
        }
    }
    Ok(())
}
