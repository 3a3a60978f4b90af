from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, lsq_linear, minimize

import jotlight as jl
import jotlight._engine as engine
from jotlight.training import Adam, GaussNewton, ProjectedGradient, SafeSet, Step, parameter_vector
from jotlight.training.cost import Cost
from jotlight.training.gauss_newton import constrained_minimum
from jotlight.training.parameters import engine_layers
from jotlight.training.patches import PatchSampler
from reference import training as twins

SENSOR = jl.Sensor(oversampling=3)
SMALL = jl.Network.initial(SENSOR, taps=3, coefficients=20)


def scenes(rng, number):
    return rng.random((number, 16, 16), np.float32)


def cost_of(network, *, step=0, steps=10, patches=16):
    examples = PatchSampler(scenes, SENSOR, 0, patches, None, network.halo)
    return Cost(network, examples, step, steps, SafeSet(), None)


def fake_cost(curvature, slope, project, *, step=0, steps=30, size=5):
    """½ vᵀ M v + g v: `size` coefficients after one tap."""
    network = jl.Network(
        [jl.Layer(np.ones((1, 1, 1, 1)), np.zeros((1, size)), 0.0, 9 / (size - 3))], SENSOR
    )

    def value(vector):
        return 0.5 * vector @ curvature @ vector + slope @ vector

    def gradient(vector):
        return value(vector), curvature @ vector + slope

    return SimpleNamespace(
        network=network,
        step=step,
        steps=steps,
        project=project,
        value=value,
        gradient=gradient,
        normal_equations=lambda vector: (*gradient(vector), curvature),
    )


def quadratic(seed, size=6):
    rng = np.random.default_rng(seed)
    factor = rng.normal(0, 1, (size, size))
    return factor @ factor.T + 0.1 * np.eye(size), 2 * rng.normal(0, 1, size)


def box(vector):
    return vector.clip(-0.3, 0.6)


def on_simplex(vector):
    """The tap in [0, 1], and coefficients of 0 or more with sum 1.

    Nothing ties parameters of two filter banks or splines to each other: `constrained_minimum`
    pulls each bank and spline with a strength of its own, and so needs sets that are products.
    """
    falling = np.sort(vector[1:])[::-1]
    threshold = np.max((np.cumsum(falling) - 1) / np.arange(1, len(vector)))
    return np.concatenate([vector[:1].clip(0, 1), (vector[1:] - threshold).clip(0)])


@pytest.mark.parametrize(
    ("optimizer", "steps"),
    [(ProjectedGradient(0.01), 15), (Adam(), 100), (GaussNewton(0.1), 15)],
    ids=repr,
)
def test_the_cost_falls(optimizer, steps):
    learned, history = jl.train(SMALL, scenes, steps=steps, batch=16, rng=0, optimizer=optimizer)
    fresh = cost_of(SMALL, step=1000, patches=64)
    before, after = fresh.value(parameter_vector(SMALL)), fresh.value(parameter_vector(learned))
    assert after < 0.8 * before
    assert history.loss[-1] < 0.8 * history.loss[0]


def test_projected_gradient_takes_just_the_step_of_equation_13():
    size = 1e-3
    start = parameter_vector(SMALL) + np.random.default_rng(1).normal(
        0, 0.05, len(parameter_vector(SMALL))
    )
    cost = cost_of(SMALL)
    step = ProjectedGradient(size).take_step(cost, start, {})
    layers = engine_layers(SMALL, start, np.float64)
    examples = PatchSampler(scenes, SENSOR, 0, 16, None, SMALL.halo)
    (errors, _), gradient = engine.gradient(layers, examples.batch(0), None)
    expected = SafeSet().project(SMALL, start - size * gradient)
    assert np.linalg.norm(step.vector - expected) < 1e-4 * np.linalg.norm(expected - start)
    np.testing.assert_allclose(step.gradient, gradient, atol=1e-4 * np.abs(gradient).max())
    assert step.loss == pytest.approx(0.5 * errors.mean(), rel=1e-5)
    assert step.state == {}


def test_cost_is_half_the_squared_error_of_a_patch_in_the_mean():
    examples = PatchSampler(scenes, SENSOR, 0, 3, None, 0)
    batch = examples.batch(0)
    frames = SENSOR.replace(frames=3)
    seed = np.random.SeedSequence(0, spawn_key=(0, 1))
    squares = [
        np.sum((SMALL.reconstruct(frames.expose(c, seed, frames=slice(i, i + 1)), SENSOR) - c) ** 2)
        for i, c in enumerate(batch["images"])
    ]
    found = Cost(SMALL, examples, 0, 1, SafeSet(), None).value(parameter_vector(SMALL))
    assert found == pytest.approx(0.5 * np.mean(squares), rel=1e-5)


def test_adam_is_that_of_its_paper_with_steps_that_shrink_as_a_cosine():
    curvature, slope = quadratic(2)
    vector, state = np.full(6, 0.5), {}
    mean, square, expected = np.zeros(6), np.zeros(6), vector
    ranges = np.array([0.2, 1, 1, 1, 1, 1])
    for step in range(7):
        cost = fake_cost(curvature, slope, lambda x: x, step=step, steps=7)
        taken = Adam(0.05, (0.8, 0.95)).take_step(cost, vector, state)
        vector, state = taken.vector, taken.state
        gradient = curvature @ expected + slope
        mean, square = 0.8 * mean + 0.2 * gradient, 0.95 * square + 0.05 * gradient**2
        ratio = mean / (1 - 0.8 ** (step + 1)) / np.sqrt(square / (1 - 0.95 ** (step + 1)))
        expected = expected - 0.05 * (1 + np.cos(np.pi * step / 7)) / 2 * ranges * ratio
        np.testing.assert_allclose(vector, expected, rtol=1e-9)


def test_adam_leaves_alone_what_has_no_gradient():
    cost = fake_cost(np.zeros((6, 6)), np.eye(6)[2], lambda x: x)
    step = Adam().take_step(cost, np.zeros(6), {})
    assert list(np.flatnonzero(step.vector)) == [2]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("project", [box, on_simplex])
def test_gauss_newton_walks_to_theconstrained_minimum(project, seed):
    curvature, slope = quadratic(seed)
    vector, state = project(np.full(6, 0.1)), {}
    for step in range(10):
        cost = fake_cost(curvature, slope, project, step=step)
        before = cost.value(vector)
        taken = GaussNewton(0.01).take_step(cost, vector, state)
        vector, state = taken.vector, taken.state
        assert cost.value(vector) <= before
    np.testing.assert_allclose(vector, best(curvature, slope, project), atol=2e-3)


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


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("project", [box, on_simplex])
def test_the_model_is_minimised_inside_of_the_set(project, seed):
    curvature, slope = quadratic(seed)
    start = project(np.random.default_rng(seed).normal(0, 1, 6))
    cost = fake_cost(curvature, slope, project)
    # The model's gradient is that at the start.
    found = constrained_minimum(curvature, curvature @ start + slope, start, cost)
    expected = best(curvature, slope, project)
    np.testing.assert_allclose(found, project(found), atol=1e-12)
    gained = cost.value(start) - cost.value(expected)
    assert cost.value(found) - cost.value(expected) <= 1e-3 * gained + 1e-12
    assert np.linalg.norm(found - expected) <= 0.02 * np.linalg.norm(expected - start) + 1e-9


def test_gauss_newton_stays_where_every_trial_is_worse_and_raises_the_damping():
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


def test_gauss_newton_finds_the_posterior_mean_of_each_count():
    bits = 9
    layer = jl.Layer(np.ones((1, 1, 1, 1)), np.full((1, bits + 3), 0.5), 0.0, 1.0)
    network = jl.Network([layer], SENSOR)
    learned, history = jl.train(
        network, lambda rng, number: rng.random((number, 32, 32), np.float32), rng=0, batch=64,
        steps=30, optimizer=GaussNewton(0.01),
    )  # fmt: skip
    found = learned.reconstruct(np.arange(bits + 1)[None])[0]
    mean, deviation, probability = np.transpose(
        [twins.posterior(count, bits) for count in range(bits + 1)]
    )
    assert probability.sum() == pytest.approx(1)
    # As if of one step alone, of the many that are averaged.
    error = deviation / np.sqrt(64 * 32 * 32 * probability)
    assert np.all(np.abs(found - mean) < 2 * error)
    limit = 0.5 * 32**2 * np.sum(probability * deviation**2)
    assert history.loss[-1] == pytest.approx(limit, rel=0.02)
    assert 10 * np.log10(1 / np.sum(probability * deviation**2)) == pytest.approx(14.816, abs=5e-4)


def test_optimisers_do_not_change_what_they_are_given():
    cost = cost_of(SMALL)
    for optimizer in (ProjectedGradient(1e-3), Adam(), GaussNewton()):
        vector, state = parameter_vector(SMALL), {}
        for _ in range(2):
            before = vector.copy(), {name: array.copy() for name, array in state.items()}
            step = optimizer.take_step(cost, vector, state)
            assert isinstance(step, Step)
            np.testing.assert_array_equal(vector, before[0])
            for name, array in before[1].items():
                np.testing.assert_array_equal(state[name], array)
            vector, state = step.vector, step.state


@pytest.mark.parametrize("value", [0, 0.0, -1e-3, np.nan, np.inf])
@pytest.mark.parametrize(
    ("make", "name"),
    [(ProjectedGradient, "learning_rate"), (Adam, "learning_rate"), (GaussNewton, "damping")],
)
def test_a_setting_that_is_not_above_0_is_refused(make, name, value):
    with pytest.raises(ValueError, match=f"{name}: expected a finite number above 0, got"):
        make(**{name: value})


@pytest.mark.parametrize("betas", [(1.0, 0.9), (0.9, 1.0), (-0.1, 0.9), (np.nan, 0.9)])
def test_betas_of_1_or_more_is_refused(betas):
    with pytest.raises(ValueError, match=r"betas: expected two numbers in \[0, 1\)"):
        Adam(betas=betas)


def test_learning_reaches_the_limit_of_the_synthetic_scene():
    network = jl.Network.initial(SENSOR, taps=5, coefficients=20)
    learned, _ = jl.train(
        network, lambda rng, number: rng.random((number, 32, 32), np.float32),
        steps=10, batch=32, rng=0, optimizer=GaussNewton(0.01),
    )  # fmt: skip
    scene = jl.datasets.uniform_scene((1000, 1000), rng=1)
    bits = SENSOR.expose(scene, rng=2)
    before, after = (
        -10 * np.log10(np.mean((x.reconstruct(bits).astype(float) - scene) ** 2))
        for x in (network, learned)
    )
    assert after == pytest.approx(14.816, abs=0.05)
    assert before < 13


def test_a_run_that_goes_astray_is_stopped():
    with pytest.raises(
        FloatingPointError, match=r"diverges: .*; lower its learning_rate, now Proj"
    ):
        jl.train(SMALL, scenes, steps=40, batch=16, rng=3, optimizer=ProjectedGradient(1e3))


@dataclass(frozen=True)
class Wrong:
    """An optimizer of a user's."""

    loss: float = 1.0
    slope: float = 0.0
    place: float = 0.0
    steps = 5
    pixels = 1000
    advice = "lower its expectations"

    def take_step(self, cost, vector, state):
        slope = np.full_like(vector, self.slope)
        return Step(vector + self.place, state, self.loss, slope)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("part", ["loss", "slope", "place"])
def test_an_optimiser_that_gives_no_numbers_is_stopped(tmp_path, part, bad):
    path = tmp_path / "run"
    with pytest.raises(FloatingPointError, match=r"step 0: .*; lower its expectations, now Wrong"):
        jl.train(SMALL, scenes, batch=3, optimizer=Wrong(**{part: bad}), checkpoint=path)
    assert not path.exists()


def test_intensities_past_all_numbers_stop_gauss_newton_with_its_own_words():
    bright = np.full((2, 16, 16), 3e38)
    with pytest.raises(FloatingPointError, match="raise its damping"):
        jl.train(SMALL, bright, batch=2, steps=2, rng=0)
