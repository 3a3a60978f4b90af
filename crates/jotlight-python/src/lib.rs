//! The Python module `jotlight._engine`: the binding of the engine.
//!
//! Each function converts its arguments, releases the GIL, and calls a function of the crate
//! `jotlight`, which documents it. The modules have the names of the modules of `jotlight`, except
//! `arguments`, which converts arguments, and `motion_fits` and `motion_sums`, which are parts of
//! `motion`.
#![allow(missing_docs)]
#![allow(
    clippy::too_many_arguments,
    reason = "separate arguments have names in `_engine.pyi`, a tuple has none"
)]

mod arguments;
mod bits;
mod cpu;
mod diffusion;
mod filter;
mod joint;
mod likelihood;
mod mle;
mod motion;
mod motion_fits;
mod motion_sums;
mod multibit;
mod network;
mod sensing;
mod tv;
mod vst;

use std::cell::Cell;

use jotlight::error::Error;
use jotlight::threads::{install_alone, install_interruptible};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

/// The compiled engine. It checks the shapes of arrays. The Python functions that call it check all
/// other arguments.
#[pymodule]
mod _engine {
    use super::{PyModule, PyResult};
    use jotlight::network::{BRIGHT, RATIO_OF_PASS};
    use pyo3::prelude::*;

    #[pymodule_export]
    use super::bits::{
        add_block_counts, add_counts_of_blocks, reverse_bytes, set_positions, transpose_bits,
    };
    #[pymodule_export]
    use super::cpu::{choose_cpu_level, cpu_level, cpu_levels, multiply_adds, read_words};
    #[pymodule_export]
    use super::diffusion::diffuse;
    #[pymodule_export]
    use super::filter::{blur, color_lines};
    #[pymodule_export]
    use super::joint::{joint_maximum, joint_solution};
    #[pymodule_export]
    use super::likelihood::{
        detection_probability, inverse_detection_probability, likelihood_admm_update,
        likelihood_gradient_and_curvature, likelihood_information, likelihood_proximal,
        log_likelihood,
    };
    #[pymodule_export]
    use super::mle::{
        equivalent_counts, look_up_counts, mle_from_counts, mle_from_jots, mle_from_probability,
    };
    #[pymodule_export]
    use super::motion::{
        FilteredTemplate, add_shifted_values, changed_remainders, chi_squared, count_shifted,
        disagreement, displacement_equations, peak_of_shifted_scores, undo_remainders,
        velocity_scores,
    };
    #[pymodule_export]
    use super::motion_fits::{fit_affine, fit_blocks, solve_field};
    #[pymodule_export]
    use super::motion_sums::{
        accept_agreeing, add_accepted, add_counts, add_object_gain, brightness, cost_of_curve,
        mark_covered, relative_brightness, shortest_outlines, smooth_curve,
    };
    #[pymodule_export]
    use super::multibit::{
        draw_readings, readings_distribution, readings_gradient_and_curvature,
        readings_information, readings_log_likelihood, readings_log_probability, readings_moments,
    };
    #[pymodule_export]
    use super::network::{
        PreparedLayer, PyCombined, PyNetwork, activate, activate_backward, add_coarse,
        conditioning_weights, forward, gradient, has_few_photons, level_weights, local_trials,
        match_dark_regions, may_be_dim, may_have_dark_regions, normal_equations, squared_errors,
        sum_counts, trials_per_combined,
    };
    #[pymodule_export]
    use super::sensing::{
        draw_counts, expose, inner_products, kernel_taps, probability, rate, spread_adjoint,
        spread_forward, spread_normal,
    };
    #[pymodule_export]
    use super::tv::{
        differences, differences_adjoint, shrink, total_variation, total_variation_admm_update,
    };
    #[pymodule_export]
    use super::vst::{anscombe, inverse_anscombe_algebraic, inverse_anscombe_exact};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("DEBUG_BUILD", cfg!(debug_assertions))?;
        module.add("BRIGHT", BRIGHT)?;
        module.add("RATIO_OF_PASS", RATIO_OF_PASS)
    }
}

fn to_python(error: Error) -> PyErr {
    match error {
        Error::Memory { .. } => PyMemoryError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}

thread_local! {
    /// The exception that a signal handler has raised during the current call.
    static EXCEPTION: Cell<Option<PyErr>> = const { Cell::new(None) };
}

/// Run Python's signal handlers, and return whether one of them has raised an exception.
fn is_interrupted() -> bool {
    // The method itself does not have the lifetimes that `try_attach` requires.
    #[allow(clippy::redundant_closure_for_method_calls)]
    let signals = Python::try_attach(|py| py.check_signals());
    let exception = signals.and_then(Result::err);
    let is_interrupted = exception.is_some();
    EXCEPTION.set(exception);
    is_interrupted
}

/// Run `work` on `threads` threads without the GIL, and return its result.
///
/// Meanwhile the calling thread runs Python's signal handlers. If one of them raises an exception,
/// as that of Ctrl-C does, the work ends early. Python runs them in its main thread only, so calls
/// from other threads are not interrupted.
fn run<R: Send>(
    py: Python<'_>,
    threads: Option<isize>,
    work: impl FnOnce() -> jotlight::error::Result<R> + Send,
) -> PyResult<R> {
    // A negative number becomes 0, which the engine refuses.
    let threads = threads.map(|threads| threads.max(0).cast_unsigned());
    EXCEPTION.set(None);
    to_exception(py.detach(|| install_interruptible(threads, is_interrupted, work)))
}

/// Run `work` on the calling thread as [`run`] does. It must not use rayon.
fn run_alone<R: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> jotlight::error::Result<R> + Send,
) -> PyResult<R> {
    EXCEPTION.set(None);
    to_exception(py.detach(|| install_alone(is_interrupted, work)))
}

/// Return the result of a call, or the exception of a signal handler.
fn to_exception<R>(result: jotlight::error::Result<R>) -> PyResult<R> {
    match EXCEPTION.take() {
        Some(exception) => Err(exception),
        None => result.map_err(to_python),
    }
}
