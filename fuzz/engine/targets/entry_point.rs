//! Calls one entry point of the engine with hostile arguments: `fuzz/engine.py` runs all of them.
//!
//! The environment variable `JOTLIGHT_ENTRY_POINT` names the entry point. Without it, the program
//! prints all names. An entry point must return a result or an error. It must not panic, overflow,
//! or hang, and its result must not depend on the memory layout or on the number of threads.
#![no_main]

mod arrays;
mod counting;
mod estimating;
mod forward;
mod input;
mod layers;
mod likelihood;
mod motion;
mod sensing;
mod simple;
mod training;
mod variation;

use std::sync::OnceLock;

use input::Input;
use libfuzzer_sys::fuzz_target;

/// Calls an entry point with arguments from the input. It returns `None` if the input is too short.
type Check = fn(&mut Input<'_>) -> Option<()>;

static CHECK: OnceLock<Check> = OnceLock::new();

fn all_checks() -> Vec<(&'static str, Check)> {
    [
        simple::CHECKS,
        counting::CHECKS,
        motion::CHECKS,
        sensing::CHECKS,
        likelihood::CHECKS,
        estimating::CHECKS,
        variation::CHECKS,
        layers::CHECKS,
        forward::CHECKS,
        training::CHECKS,
    ]
    .concat()
}

fn choose_check() {
    let checks = all_checks();
    let name = std::env::var("JOTLIGHT_ENTRY_POINT").unwrap_or_default();
    match checks.iter().find(|(known, _)| *known == name) {
        Some((_, check)) => {
            let _ = CHECK.set(*check);
        }
        None => {
            for (name, _) in checks {
                println!("{name}");
            }
            std::process::exit(0);
        }
    }
}

fuzz_target!(init: choose_check(), |data: &[u8]| {
    if let Some(check) = CHECK.get() {
        check(&mut Input::new(data));
    }
});
