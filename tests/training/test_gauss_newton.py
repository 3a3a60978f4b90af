"""The projected Gauss-Newton method."""

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, lsq_linear, minimize

import jotlight as jl
from jotlight.training import GaussNewton
from jotlight.training.gauss_newton import constrained_minimum
from quadratic_cost import fake_cost, quadratic
from reference import training as twins

SENSOR = jl.Sensor(oversampling=3)
SMALL = jl.Network.initial(SENSOR, taps=3, coefficients=20)


def box(vector):
    return vector.clip(-0.3, 0.6)


def on_simplex(vector):
    """The projection on a tap in [0, 1] and on coefficients of 0 or more with sum 1.

    No condition links two filter banks or splines. `constrained_minimum` needs that, since it has a
    penalty for each of them.
    """
    falling = np.sort(vector[1:])[::-1]
    threshold = np.max((np.cumsum(falling) - 1) / np.arange(1, len(vector)))
    return np.concatenate([vector[:1].clip(0, 1), (vector[1:] - threshold).clip(0)])


def best(curvature, slope, project):
    """The constrained minimum of ½ vᵀ M v + g v, by SciPy."""
    if project is box:
        factor = np.linalg.cholesky(curvature).T
        return lsq_linear(factor, np.linalg.solve(factor.T, -slope), (-0.3, 0.6), tol=1e-14).x
    return minimize(
        lambda x: 0.5 * x @ curvature @ x + slope @ x,
        np.full(6, 1 / 5),
        jac=lambda x: curvature @ x + slope,
        bounds=[(0, 1)] * 6,
        constraints=LinearConstraint([[0, 1, 1, 1, 1, 1]], 1, 1),
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    ).x


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("project", [box, on_simplex])
def test_steps_converge_to_the_constrained_minimum(project, seed):
    curvature, slope = quadratic(seed)
    vector, state = project(np.full(6, 0.1)), {}
    for step in range(10):
        cost = fake_cost(curvature, slope, project, step=step)
        before = cost.value(vector)
        taken = GaussNewton(0.01).take_step(cost, vector, state)
        vector, state = taken.vector, taken.state
        assert cost.value(vector) <= before
    np.testing.assert_allclose(vector, best(curvature, slope, project), atol=2e-3)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("project", [box, on_simplex])
def test_the_model_is_minimized_inside_the_set(project, seed):
    curvature, slope = quadratic(seed)
    start = project(np.random.default_rng(seed).normal(0, 1, 6))
    cost = fake_cost(curvature, slope, project)
    # The gradient of the model at the start.
    found = constrained_minimum(curvature, curvature @ start + slope, start, cost)
    expected = best(curvature, slope, project)
    np.testing.assert_allclose(found, project(found), atol=1e-12)
    gained = cost.value(start) - cost.value(expected)
    assert cost.value(found) - cost.value(expected) <= 1e-3 * gained + 1e-12
    assert np.linalg.norm(found - expected) <= 0.02 * np.linalg.norm(expected - start) + 1e-9


def test_a_step_without_a_better_trial_stays_and_raises_the_damping():
    curvature, slope = quadratic(3)
    cost = fake_cost(curvature, slope, box)
    cost.value = lambda _: np.inf
    start = np.zeros(6)
    taken = GaussNewton(damping=0.5).take_step(cost, start, {})
    np.testing.assert_array_equal(taken.vector, start)
    assert taken.state["damping"] > 0.5
    again = GaussNewton(damping=0.5).take_step(fake_cost(curvature, slope, box), start, taken.state)
    assert again.state["damping"] < taken.state["damping"]
    assert (again.vector != start).any()


@pytest.mark.slow
def test_training_finds_the_posterior_mean_of_each_count():
    bits = 9
    layer = jl.Layer(np.ones((1, 1, 1, 1)), np.full((1, bits + 3), 0.5), 0.0, 1.0)
    network = jl.Network([layer], SENSOR)
    trained, history = jl.train(
        network, lambda rng, number: rng.random((number, 32, 32), np.float32), rng=0, batch=64,
        steps=30, optimizer=GaussNewton(0.01),
    )  # fmt: skip
    found = trained.reconstruct(np.arange(bits + 1)[None])[0]
    mean, deviation, probability = np.transpose(
        [twins.posterior(count, bits) for count in range(bits + 1)]
    )
    assert probability.sum() == pytest.approx(1)
    # The standard error of a single step; the average over steps has a smaller one.
    error = deviation / np.sqrt(64 * 32 * 32 * probability)
    assert np.all(np.abs(found - mean) < 2 * error)
    limit = 0.5 * 32**2 * np.sum(probability * deviation**2)
    assert history.loss[-1] == pytest.approx(limit, rel=0.02)
    assert 10 * np.log10(1 / np.sum(probability * deviation**2)) == pytest.approx(14.816, abs=5e-4)


@pytest.mark.slow
def test_training_reaches_the_limit_for_uniform_scenes():
    network = jl.Network.initial(SENSOR, taps=5, coefficients=20)
    trained, _ = jl.train(
        network, lambda rng, number: rng.random((number, 32, 32), np.float32),
        steps=10, batch=32, rng=0, optimizer=GaussNewton(0.01),
    )  # fmt: skip
    scene = jl.datasets.uniform_scene((1000, 1000), rng=1)
    bits = SENSOR.expose(scene, rng=2)
    before, after = (
        -10 * np.log10(np.mean((x.reconstruct(bits).astype(float) - scene) ** 2))
        for x in (network, trained)
    )
    assert after == pytest.approx(14.816, abs=0.05)
    assert before < 13


def test_overflow_stops_a_run_with_advice_for_gauss_newton():
    bright = np.full((2, 16, 16), 3e38)
    with pytest.raises(FloatingPointError, match="raise its damping"):
        jl.train(SMALL, bright, batch=2, steps=2, rng=0)
