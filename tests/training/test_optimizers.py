"""First-order optimizers, and rules for all optimizers."""

from dataclasses import dataclass

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.training import Adam, GaussNewton, ProjectedGradient, SafeSet, Step, parameter_vector
from jotlight.training.cost import Cost
from jotlight.training.parameters import engine_layers
from jotlight.training.patches import PatchSampler
from quadratic_cost import fake_cost, quadratic

SENSOR = jl.Sensor(oversampling=3)
SMALL = jl.Network.initial(SENSOR, taps=3, coefficients=20)


def scenes(rng, number):
    return rng.random((number, 16, 16), np.float32)


def cost_of(network, *, step=0, steps=10, patches=16):
    examples = PatchSampler(scenes, SENSOR, 0, patches, None, network.halo)
    return Cost(network, examples, step, steps, SafeSet(), None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("optimizer", "steps"),
    [(ProjectedGradient(0.01), 15), (Adam(), 100), (GaussNewton(0.1), 15)],
    ids=repr,
)
def test_every_optimizer_lowers_the_cost(optimizer, steps):
    trained, history = jl.train(SMALL, scenes, steps=steps, batch=16, rng=0, optimizer=optimizer)
    fresh = cost_of(SMALL, step=1000, patches=64)
    before, after = fresh.value(parameter_vector(SMALL)), fresh.value(parameter_vector(trained))
    assert after < 0.8 * before
    assert history.loss[-1] < 0.8 * history.loss[0]


def test_projected_gradient_takes_the_step_of_equation_13():
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


def test_the_cost_is_half_the_squared_error_averaged_over_patches():
    """An untied network is trained with the bits of `Sensor.expose`, a tied one with counts."""
    network = jl.Network.initial(SENSOR, taps=3, coefficients=20, tied=False)
    examples = PatchSampler(scenes, SENSOR, 0, 3, None, 0)
    batch = examples.batch(0)
    frames = SENSOR.replace(frames=3)
    seed = np.random.SeedSequence(0, spawn_key=(0, 1))
    squares = [
        np.sum(
            (network.reconstruct(frames.expose(c, seed, frames=slice(i, i + 1)), SENSOR) - c) ** 2
        )
        for i, c in enumerate(batch["images"])
    ]
    found = Cost(network, examples, 0, 1, SafeSet(), None).value(parameter_vector(network))
    assert found == pytest.approx(0.5 * np.mean(squares), rel=1e-5)


def test_adam_follows_its_paper_with_a_cosine_learning_rate():
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


def test_adam_keeps_parameters_without_a_gradient():
    cost = fake_cost(np.zeros((6, 6)), np.eye(6)[2], lambda x: x)
    step = Adam().take_step(cost, np.zeros(6), {})
    assert list(np.flatnonzero(step.vector)) == [2]


def test_optimizers_do_not_modify_their_arguments():
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


NOT_BETAS = [
    *((1.0, 0.9), (0.9, 1.0), (-0.1, 0.9), (np.nan, 0.9)),
    *((0.9,), (0.9, 0.99, 0.9), 0.9, ("a", "b"), None),
]


@pytest.mark.parametrize("betas", NOT_BETAS)
def test_adam_has_two_betas_from_0_to_1(betas):
    with pytest.raises(ValueError, match=r"betas: expected two numbers in \[0, 1\)"):
        Adam(betas=betas)


def test_a_diverging_run_is_stopped():
    with pytest.raises(
        FloatingPointError, match=r"diverges: .*; optimizer Proj.*: lower its learning_rate"
    ):
        jl.train(SMALL, scenes, steps=40, batch=16, rng=3, optimizer=ProjectedGradient(1e3))


def test_a_short_run_with_a_much_worse_result_is_reported():
    message = "the result is much worse than the network at the start: .*: lower its learning_rate"
    with pytest.warns(jl.JotlightWarning, match=message):
        jl.train(SMALL, scenes, steps=2, batch=16, rng=3, optimizer=ProjectedGradient(1e3))


@dataclass(frozen=True)
class Wrong:
    """A user-defined optimizer."""

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
def test_an_optimizer_that_returns_infinity_or_nan_is_stopped(tmp_path, part, bad):
    path = tmp_path / "run"
    with pytest.raises(
        FloatingPointError, match=r"step 0: .*; optimizer Wrong.*: lower its expectations"
    ):
        jl.train(SMALL, scenes, batch=3, optimizer=Wrong(**{part: bad}), checkpoint=path)
    assert not path.exists()


@pytest.mark.parametrize("rate", [np.logspace(-3, -1, 3)[1], np.array(0.01), np.float64(0.01)])
def test_settings_are_plain_numbers_so_equal_optimizers_have_equal_names(rate):
    for kind in (Adam, ProjectedGradient):
        optimizer = kind(learning_rate=rate)
        assert repr(optimizer) == repr(kind(learning_rate=0.01))
        assert hash(optimizer) == hash(kind(learning_rate=0.01))
    assert repr(GaussNewton(damping=rate)) == "GaussNewton(damping=0.01)"
    assert repr(SafeSet(nu=rate)) == "SafeSet(nu=0.01, monotone=True)"
    assert Adam(betas=np.array([0.9, 0.99])) == Adam(betas=(0.9, 0.99))


def test_settings_of_the_safe_set_are_checked():
    for nu in ("a", None, [1.0], -1, np.inf):
        with pytest.raises(ValueError, match="nu: expected a number of 0 or more"):
            SafeSet(nu=nu)
    with pytest.raises(TypeError, match="monotone: expected True or False"):
        SafeSet(monotone="no")
