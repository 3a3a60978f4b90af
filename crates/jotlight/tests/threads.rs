#![allow(missing_docs)]
#![cfg(target_os = "linux")]

use std::error::Error;

use jotlight::threads;
use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// The cores of each thread that works.
fn shares(number: usize) -> Result<Vec<CpuSet>> {
    let shares = threads::install(Some(number), || {
        rayon::broadcast(|_| sched_getaffinity(None))
    })?;
    Ok(shares.into_iter().collect::<rustix::io::Result<_>>()?)
}

fn cores(set: &CpuSet) -> Vec<usize> {
    let all = 0..CpuSet::MAX_CPU;
    all.filter(|&core| set.is_set(core)).collect()
}

#[test]
fn threads_share_the_cores_out() -> Result<()> {
    let allowed = cores(&sched_getaffinity(None)?);
    let numbers = [1, 2, 3, allowed.len()];
    for number in numbers.into_iter().filter(|&n| n <= allowed.len()) {
        let mut shares: Vec<_> = shares(number)?.iter().map(cores).collect();
        let sizes = shares.iter().map(Vec::len);
        assert!(sizes.clone().max() <= sizes.min().map(|least| least + 1));
        shares.sort();
        let mut together = shares.concat();
        together.sort_unstable();
        assert_eq!(together, allowed, "{number} threads");
    }
    // More threads than cores: each core has its part of them.
    let more = shares(2 * allowed.len())?;
    for &core in &allowed {
        let its = more.iter().filter(|share| share.is_set(core));
        assert_eq!(its.count(), 2, "core {core}");
    }
    Ok(())
}

#[test]
fn the_first_thread_has_the_callers_core() -> Result<()> {
    let allowed = sched_getaffinity(None)?;
    let Some(&second) = cores(&allowed).get(1) else {
        return Ok(());
    };
    let mut one = CpuSet::new();
    one.set(second);
    let mut stayed = 0;
    let mut held = 0;
    for _ in 0..200 {
        // It mostly stays there.
        sched_setaffinity(None, &one)?;
        sched_setaffinity(None, &allowed)?;
        let core = sched_getcpu();
        let shares = shares(2)?;
        // Else the caller may have moved before its core was asked for.
        if core == second && core == sched_getcpu() {
            stayed += 1;
            held += usize::from(shares[0].is_set(core));
        }
    }
    assert!(stayed > 0);
    assert!(held * 10 >= stayed * 9, "{held} of {stayed}");
    Ok(())
}

#[test]
fn threads_stay_with_the_cores_of_the_caller() -> Result<()> {
    let before = sched_getaffinity(None)?;
    let mut one = CpuSet::new();
    one.set(sched_getcpu());
    // The same threads wait for the next call.
    for kept in [before, one, before] {
        sched_setaffinity(None, &kept)?;
        for share in shares(2)? {
            let share = cores(&share);
            assert!(!share.is_empty());
            assert!(share.iter().all(|&core| kept.is_set(core)));
        }
    }
    Ok(())
}
