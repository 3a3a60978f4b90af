//! Tests that choose the level of instructions, against simple loops.
//!
//! The level is that of all threads, so the other tests of this program expect nothing that depends
//! on it. Those of the engine do, and are another program.

#[path = "../random/mod.rs"]
mod random;

mod bits;
mod layout;
mod motion_counts;
mod motion_fields;
mod motion_scoring;
mod motion_values;

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

use jotlight::cpu::Level;
use jotlight::error::Result;
use ndarray::Array4;

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// The right to choose the level. At its end, the level is that of the processor again.
struct Choice(#[allow(dead_code, reason = "the lock is held")] MutexGuard<'static, ()>);

impl Choice {
    fn wait() -> Self {
        // A test that failed has left a level that works.
        Self(ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for Choice {
    fn drop(&mut self) {
        assert!(Level::choose(None).is_ok());
    }
}

/// Run a test on every level, while no other test chooses the level.
fn on_every_level(mut test: impl FnMut(Level) -> Result<()>) -> Result<()> {
    let _choice = Choice::wait();
    for level in Level::supported() {
        Level::choose(Some(level.name()))?;
        test(level)?;
    }
    Ok(())
}

#[test]
fn tests_of_levels_do_not_disturb_each_other() {
    thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for _ in 0..100 {
                    let on_each = on_every_level(|level| {
                        thread::yield_now();
                        assert_eq!(Level::current(), level);
                        Ok(())
                    });
                    assert!(on_each.is_ok());
                    assert!(on_every_level(|_| Level::choose(Some("none"))).is_err());
                }
            });
        }
    });
}

#[test]
fn a_test_that_fails_leaves_the_level_of_the_processor() {
    let fastest = Level::supported().pop();
    let ended = thread::spawn(|| {
        let _choice = Choice::wait();
        assert!(Level::choose(Some("scalar")).is_ok());
        unreachable!("the test fails");
    });
    assert!(ended.join().is_err());
    let _choice = Choice::wait();
    assert_eq!(Some(Level::current()), fastest);
}

/// Return fields of displacements of two blocks of images that are not of 20 × 30 pixels: the
/// fields, the side of their tiles, and the size of the images.
fn fields_of_other_sizes() -> impl Iterator<Item = (Array4<f32>, Option<usize>, [usize; 2])> {
    [
        ((2, 2), Some(16), [20, 31]),
        ((2, 2), Some(16), [19, 30]),
        ((3, 4), Some(16), [40, 60]),
        ((1, 1), Some(16), [10, 15]),
        ((20, 29), None, [20, 29]),
        ((0, 0), Some(16), [0, 0]),
    ]
    .into_iter()
    .map(|(nodes, tile, size)| (Array4::zeros((2, 2, nodes.0, nodes.1)), tile, size))
}
