"""Callbacks, histories, warnings, and starts of the iterative methods."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.iterative.convergence import ConvergenceMonitor
from reference import iterative
from reference.iterative import run, scene

SOLVERS = ["newton", "gradient"]


def smooth_bits(kernel, oversampling):
    sensor = jl.Sensor(oversampling=oversampling, frames=3, kernel=kernel)
    return sensor, sensor.expose(scene(12, 12), rng=oversampling)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
@pytest.mark.parametrize("tol", [1e-2, 1e-3])
def test_admm_records_its_residuals_and_stops_when_both_are_small(kernel, tol):
    sensor = jl.Sensor(oversampling=4, frames=2, kernel=kernel)
    bits = sensor.expose(scene(16, 16), rng=7)
    estimate, history, estimates = run(jl.admm_tv, bits, sensor, weight=4.0, tol=tol)
    primal, dual = history.residuals["primal"], history.residuals["dual"]
    assert history.converged
    assert history.iterations == len(primal) == len(dual) == len(estimates)
    small = (primal <= tol) & (dual <= 10 * tol)
    assert small.nonzero()[0].tolist() == [history.iterations - 1]
    assert history.weight == 4.0
    np.testing.assert_array_equal(estimate, estimates[-1].astype(np.float32))
    objective = iterative.build_cost(bits, sensor)(estimates[-1])
    objective += iterative.total_variation(estimates[-1], "isotropic", 4.0)
    # admm_tv replaces light below a millionth of the brightest where it would give -inf.
    assert history.objective == pytest.approx(objective, rel=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
def test_maximum_likelihood_records_its_residuals_and_stops_when_they_are_small(solver):
    sensor, bits = smooth_bits("linear", 3)
    estimate, history, estimates = run(jl.mle_iterative, bits, sensor, solver=solver, tol=1e-5)
    (residuals,) = history.residuals.values()
    assert history.converged
    assert history.iterations == len(residuals) == len(estimates)
    assert residuals[-1] <= 1e-5 < residuals[:-1].min()
    assert history.weight == 0
    np.testing.assert_array_equal(estimate, estimates[-1].astype(np.float32))
    cost = iterative.build_cost(bits, sensor)
    assert residuals[-1] == pytest.approx(cost.projected_gradient(estimates[-1]), rel=1e-6)
    assert history.objective == pytest.approx(cost(estimates[-1]), rel=1e-11)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_smaller_tolerance_takes_more_iterations_and_lowers_the_cost(solver):
    sensor, bits = smooth_bits("quadratic", 2)
    cost = iterative.build_cost(bits, sensor)
    runs = [
        run(jl.mle_iterative, bits, sensor, solver=solver, tol=10.0**-power) for power in (2, 4, 6)
    ]
    costs = [cost(estimates[-1]) for *_, estimates in runs]
    assert costs[0] > costs[1] > costs[2]
    assert runs[0][1].iterations < runs[1][1].iterations < runs[2][1].iterations


@pytest.mark.parametrize("method", [jl.mle_iterative, jl.admm_tv])
def test_a_callback_receives_every_iteration_and_may_end_the_run(method):
    sensor, bits = smooth_bits("cubic", 2)
    iterations = []

    def stop_after_4(iteration):
        iterations.append(iteration)
        assert not iteration.estimate.flags.writeable
        if iteration.number == 4:
            raise StopIteration

    estimate, history = method(
        bits, sensor, callback=stop_after_4, return_history=True, tol=1e-5, max_iter=77
    )
    assert [iteration.number for iteration in iterations] == [1, 2, 3, 4]
    assert iterations[0] == iterations[0] != iterations[1]
    assert {(iteration.tol, iteration.max_iter) for iteration in iterations} == {(1e-5, 77)}
    assert (history.converged, history.iterations) == (False, 4)
    np.testing.assert_array_equal(estimate, iterations[-1].estimate.astype(np.float32))
    residuals = [iteration.residual for iteration in iterations]
    if method is jl.mle_iterative:
        assert residuals == list(history.residuals["projected gradient"])
    else:
        largest = np.maximum(history.residuals["primal"], history.residuals["dual"] / 10)
        np.testing.assert_allclose(residuals, largest, rtol=1e-12)


def test_an_exception_in_a_callback_reaches_the_caller():
    def fail(iteration):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        jl.mle_iterative([[2]], jl.Sensor(frames=4), callback=fail)


@pytest.mark.parametrize("solver", SOLVERS)
def test_maximum_likelihood_warns_once_when_the_iterations_do_not_suffice(solver):
    sensor, bits = smooth_bits("cubic", 2)
    with pytest.warns(jl.JotlightWarning, match="not converged after 1 iteration") as caught:
        estimate, history = jl.mle_iterative(
            bits, sensor, solver=solver, max_iter=1, return_history=True
        )
    assert len(caught) == 1
    assert (history.converged, history.iterations) == (False, 1)
    assert (estimate >= 0).all()
    assert (estimate <= 1).all()


def test_admm_warns_once_when_the_iterations_do_not_suffice():
    sensor = jl.Sensor(oversampling=4)
    bits = sensor.expose(scene(16, 16), rng=0)
    message = "admm_tv: not converged after 2 iterations.*primal.*dual.*tol = 0.001"
    with pytest.warns(jl.JotlightWarning, match=message) as caught:
        _, history = jl.admm_tv(bits, sensor, max_iter=2, return_history=True)
    assert len(caught) == 1
    assert (history.converged, history.iterations) == (False, 2)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
def test_admm_converges_faster_from_a_start_near_the_solution(kernel):
    sensor = jl.Sensor(oversampling=4, kernel=kernel)
    bits = sensor.expose(scene(24, 24), rng=9)
    estimate, history, _ = run(jl.admm_tv, bits, sensor, tol=1e-4)
    start = estimate.copy()
    _, resumed, _ = run(jl.admm_tv, bits, sensor, start=start, tol=1e-4)
    assert resumed.iterations < history.iterations
    assert resumed.objective == pytest.approx(history.objective, rel=2e-5)
    np.testing.assert_array_equal(start, estimate)


@pytest.mark.slow
@pytest.mark.parametrize("kernel", ["box", "quadratic", "cubic"])
def test_admm_needs_no_more_iterations_from_its_own_solution(kernel):
    image = jl.datasets.photograph("camera")[100:148, 180:228]
    sensor = jl.Sensor(oversampling=4, kernel=kernel)
    bits = sensor.expose(image, rng=0)
    estimate, first = jl.admm_tv(bits, sensor, return_history=True)
    _, again = jl.admm_tv(bits, sensor, start=estimate, weight=first.weight, return_history=True)
    assert again.converged
    assert again.iterations <= first.iterations


@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS)
def test_maximum_likelihood_converges_faster_from_a_start_near_the_solution(solver):
    sensor, bits = smooth_bits("quadratic", 3)
    estimate, history, _ = run(jl.mle_iterative, bits, sensor, solver=solver)
    again, resumed, _ = run(jl.mle_iterative, bits, sensor, solver=solver, start=estimate)
    assert resumed.iterations < history.iterations / 2
    assert resumed.objective == pytest.approx(history.objective, rel=1e-9)
    np.testing.assert_allclose(again, estimate, atol=1e-3)


def test_the_start_does_not_change_the_objective_of_admm():
    sensor = jl.Sensor(oversampling=4)
    bits = sensor.expose(scene(16, 16), rng=0)
    start = np.random.default_rng(10).uniform(-1, 3, (16, 16))
    _, random, _ = run(jl.admm_tv, bits, sensor, start=start, tol=1e-4)
    _, default, _ = run(jl.admm_tv, bits, sensor, tol=1e-4)
    assert random.objective == pytest.approx(default.objective, rel=2e-5)


def test_a_start_outside_of_0_to_s_is_clipped_and_does_not_change_the_maximum_likelihood():
    sensor, bits = smooth_bits("linear", 2)
    start = np.random.default_rng(9).uniform(-1, 3, (12, 12))
    before = start.copy()
    _, random, estimates = run(jl.mle_iterative, bits, sensor, start=start)
    _, default, _ = run(jl.mle_iterative, bits, sensor)
    assert 0 <= estimates[0].min() <= estimates[0].max() <= 1
    assert random.objective == pytest.approx(default.objective, rel=1e-9)
    np.testing.assert_array_equal(start, before)


@pytest.mark.parametrize("method", [jl.mle_iterative, jl.admm_tv])
@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"tol": 0}, ValueError, "tol: expected a finite number above 0, got 0"),
        ({"tol": -1}, ValueError, "tol: expected a finite number above 0, got -1"),
        ({"tol": np.inf}, ValueError, "tol: expected a finite .*, got inf"),
        ({"tol": np.nan}, ValueError, "tol: expected a finite .*, got nan"),
        ({"tol": True}, ValueError, "tol: expected a finite .*, got True"),
        ({"tol": 1e-3 + 0j}, ValueError, "tol: expected a finite .*, got "),
        ({"max_iter": 0}, ValueError, "max_iter: expected at least 1, got 0"),
        ({"max_iter": 1.5}, TypeError, "max_iter: expected a whole number, got 1.5"),
    ],
)
def test_an_invalid_stopping_rule_is_refused(method, options, error, message):
    with pytest.raises(error, match=message):
        method(np.ones((4, 4), int), jl.Sensor(oversampling=2), **options)


def test_a_tolerance_may_be_an_array_of_one_number():
    assert ConvergenceMonitor("halving", 10, np.array(1e-3), None).tol == 1e-3


@pytest.mark.slow
def test_a_notebook_shows_the_state_and_the_residuals():
    bits = jl.Sensor(oversampling=3, kernel="linear").expose(np.full((8, 8), 0.5), rng=0)
    _, history = jl.mle_iterative(bits, return_history=True)
    html = history._repr_html_()
    assert "not converged" not in html
    assert all(name in html for name in ("converged", str(history.iterations), *history.residuals))


@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize("largest", [1e4, 1e18])
@pytest.mark.parametrize("method", [jl.mle_iterative, jl.admm_tv])
def test_a_largest_intensity_far_above_the_scene_changes_nothing(method, largest, kernel):
    sensor = jl.Sensor(oversampling=2, frames=64, kernel=kernel, max_intensity=30.0)
    bits = sensor.expose(scene(8, 8), rng=3)
    expected = method(bits, sensor)
    found = method(bits, sensor.replace(max_intensity=largest))
    np.testing.assert_allclose(found, expected, rtol=1e-2, atol=1e-3)


def test_the_scale_of_dark_images_is_their_noise():
    operator, counts = jl.operators.scaling((2, 2), 1.0), np.zeros((2, 2), int)
    dark = jl.Likelihood(counts, trials=2500)
    assert jl.Problem(operator, dark, 1e9).intensity_scales() == pytest.approx(7.1e-4, rel=0.01)
    hot = jl.Likelihood(counts + 900, trials=2500, dark_counts=1.0)
    slope, fraction = 0.64, 0.36  # at the rate of the counts
    noise = (fraction * slope / 10_000) ** 0.5 / slope
    assert jl.Problem(operator, hot, 1e9).intensity_scales() == pytest.approx(10 * noise, rel=0.01)
