//! The distribution of the caller's cores over the threads of a pool.
#![cfg(target_os = "linux")]

use std::error::Error;

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

fn cores(set: &CpuSet) -> Vec<usize> {
    let all = 0..CpuSet::MAX_CPU;
    all.filter(|&core| set.is_set(core)).collect()
}

#[test]
fn threads_divide_the_cores_evenly() -> Result<()> {
    let allowed = cores(&sched_getaffinity(None)?);
    let numbers = [1, 2, 3, allowed.len()];
    for number in numbers.into_iter().filter(|&n| n <= allowed.len()) {
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
