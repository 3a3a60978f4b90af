import numpy as np
import pytest

import jotlight as jl
from jotlight.images.io import read_image
from reference import iterative
from reference.iterative import scene

SOLVERS = ["newton", "gradient"]


def run(data, sensor=None, **options):
    return iterative.run(jl.mle_iterative, data, sensor, **options)


DARK = np.random.default_rng(0).uniform(0, 0.4, (6, 7))
MASK = np.random.default_rng(1).random((12, 14)) < 0.3
MASK[::2, ::2] = False
BOX_SENSORS = {
    "plain": {},
    "efficiency": {"efficiency": 0.4, "gain": 30.0},
    "dark counts": {"dark_counts": 0.2},
    "dark counts per pixel": {"dark_counts": DARK.repeat(2, 0).repeat(2, 1)},
    "dark counts per jot": {"dark_counts": np.random.default_rng(2).uniform(0, 0.4, (12, 14))},
    "dead jots": {"mask": MASK},
    "all": {"mask": MASK, "dark_counts": DARK.repeat(2, 0).repeat(2, 1), "efficiency": 0.7},
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("name", BOX_SENSORS)
def test_for_the_box_kernel_the_estimate_is_the_closed_form(name, threshold, solver):
    sensor = jl.Sensor(oversampling=2, frames=6, threshold=threshold, **BOX_SENSORS[name])
    sensor = sensor.replace(gain=sensor.gain * threshold)
    bits = sensor.expose(scene(6, 7), rng=3)
    expected = jl.mle(bits, sensor)
    assert expected.min() < 0.1 < 0.6 < expected.max()
    estimate = jl.mle_iterative(bits, sensor, solver=solver)
    np.testing.assert_allclose(estimate, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("name", ["plain", "efficiency", "dark counts", "dark counts per pixel"])
def test_counts_suffice_for_the_box_kernel(name, threshold, solver):
    sensor = jl.Sensor(oversampling=2, frames=6, threshold=threshold, **BOX_SENSORS[name])
    sensor = sensor.replace(gain=sensor.gain * threshold)
    counts = np.random.default_rng(4).integers(0, 25, (6, 7))
    counts[0, :2] = 0, 24
    estimate = jl.mle_iterative(counts, sensor, solver=solver)
    np.testing.assert_allclose(estimate, jl.mle(counts, sensor), rtol=0, atol=1e-5)


def smooth_bits(kernel, oversampling, threshold, **options):
    max_intensity = float(threshold)
    sensor = jl.Sensor(
        oversampling=oversampling,
        frames=3,
        kernel=kernel,
        threshold=threshold,
        max_intensity=max_intensity,
        **options,
    )
    return sensor, sensor.expose(max_intensity * scene(12, 12), rng=oversampling)


@pytest.mark.parametrize(
    ("kernel", "oversampling", "threshold"),
    [
        ("linear", 2, 2),
        pytest.param("linear", 4, 1, marks=pytest.mark.exhaustive),
        ("quadratic", 2, 1),
        pytest.param("quadratic", 3, 2, marks=pytest.mark.exhaustive),
        ("cubic", 3, 2),
        pytest.param("cubic", 4, 1, marks=pytest.mark.exhaustive),
    ],
)
@pytest.mark.slow
def test_the_likelihood_equals_the_maximum_that_scipy_finds(kernel, oversampling, threshold):
    sensor, bits = smooth_bits(kernel, oversampling, threshold)
    cost = iterative.build_cost(bits, sensor)
    minimum = cost(cost.minimize())
    for solver in SOLVERS:
        estimate, history, estimates = run(bits, sensor, solver=solver, max_iter=2000)
        assert cost(estimates[-1]) == pytest.approx(minimum, rel=1e-9)
        assert cost(estimate) == pytest.approx(minimum, rel=1e-6)
        assert history.objective == pytest.approx(cost(estimates[-1]), rel=1e-11)
        assert cost.projected_gradient(estimates[-1]) < 2e-6


@pytest.mark.parametrize("solver", SOLVERS)
def test_imperfect_jots_and_a_smooth_kernel_together_reach_the_maximum(solver):
    rng = np.random.default_rng(5)
    sensor, bits = smooth_bits(
        "quadratic",
        2,
        2,
        mask=rng.random((24, 24)) < 0.2,
        dark_counts=rng.uniform(0, 0.3, (24, 24)),
        efficiency=0.6,
    )
    cost = iterative.build_cost(bits, sensor)
    _, _, estimates = run(bits, sensor, solver=solver, max_iter=2000)
    assert cost(estimates[-1]) == pytest.approx(cost(cost.minimize()), rel=1e-9)
    assert cost.projected_gradient(estimates[-1]) < 2e-6


@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 2])
def test_the_likelihood_increases_in_every_iteration(threshold, solver):
    sensor, bits = smooth_bits("cubic", 3, threshold)
    cost = iterative.build_cost(bits, sensor)
    _, _, estimates = run(bits, sensor, solver=solver, max_iter=2000)
    costs = np.array([cost(image) for image in estimates])
    assert (np.diff(costs) <= 1e-12 * costs[0]).all()
    assert costs[-1] < 0.99 * costs[0]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kernel", ["linear", "quadratic", "cubic"])
@pytest.mark.slow
def test_fewer_ones_than_pixels_reach_the_maximum_too(kernel, solver):
    """The likelihood then has no curvature along some directions."""
    sensor = jl.Sensor(oversampling=2, frames=5, gain=2.0, kernel=kernel)
    for seed in range(3):
        bits = sensor.expose(scene(8, 7), rng=seed)
        assert 10 < bits.to_array().sum() < 56
        cost = iterative.build_cost(bits, sensor)
        _, _, estimates = run(bits, sensor, solver=solver)
        assert cost(estimates[-1]) == pytest.approx(cost(cost.minimize()), rel=1e-8)


@pytest.mark.parametrize("bit", [0, 1])
def test_bits_that_are_all_0_give_0_and_bits_that_are_all_1_give_s(bit):
    sensor = jl.Sensor(oversampling=2, kernel="cubic", max_intensity=3.0)
    bits = jl.Bits.from_array(np.full((1, 10, 12), bit))
    np.testing.assert_array_equal(jl.mle_iterative(bits, sensor), 3.0 * bit)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 3])
def test_a_signal_reaches_the_maximum(threshold, solver):
    matrix = 3.0 * iterative.spread_matrix((15,), "cubic", 3)
    light = jl.operators.spread((15,), oversampling=3, kernel="cubic", gain=3.0)
    ones = np.random.default_rng(6).binomial(20, np.linspace(0.2, 0.7, 45))
    problem = jl.Problem(light, jl.Likelihood(ones, trials=20, threshold=threshold), 5.0)
    estimate, history, estimates = run(problem, solver=solver, max_iter=2000)
    cost = iterative.Cost(matrix, ones, 20, threshold, max_intensity=5.0)
    assert (estimate.shape, estimate.dtype) == ((15,), np.float32)
    assert history.objective == pytest.approx(cost(cost.minimize()), rel=1e-9)
    assert cost.projected_gradient(estimates[-1]) < 2e-6


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 2])
def test_a_custom_operator_reaches_the_maximum(threshold, solver):
    rng = np.random.default_rng(7)
    matrix = rng.exponential(1, (200, 12)) * (rng.random((200, 12)) < 0.3)
    operator = jl.operators.Operator(
        lambda image: matrix @ image.ravel(),
        lambda light: (matrix.T @ light).reshape(3, 4),
        (3, 4),
        (200,),
    )
    dark = rng.uniform(0, 0.2, 200)
    ones = rng.binomial(5, -np.expm1(-matrix @ rng.uniform(0, 1, 12) - dark))
    likelihood = jl.Likelihood(ones, trials=5, threshold=threshold, dark_counts=dark)
    problem = jl.Problem(operator, likelihood, 2.0)
    estimate, history, estimates = run(problem, solver=solver, max_iter=2000)
    cost = iterative.Cost(matrix, ones, 5, threshold, dark, max_intensity=2.0)
    assert estimate.shape == (3, 4)
    assert history.objective == pytest.approx(cost(cost.minimize()), rel=1e-9)
    assert cost.projected_gradient(estimates[-1]) < 2e-6


@pytest.mark.slow
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kernel", ["box", "cubic"])
def test_the_number_of_threads_does_not_change_the_estimate(kernel, solver):
    sensor = jl.Sensor(oversampling=4, frames=2, kernel=kernel)
    bits = sensor.expose(scene(47, 51), rng=10)
    estimates = [
        jl.mle_iterative(bits, sensor, solver=solver, tol=1e-2, threads=threads)
        for threads in (1, 2, 7)
    ]
    np.testing.assert_array_equal(estimates[1], estimates[0])
    np.testing.assert_array_equal(estimates[2], estimates[0])


@pytest.mark.parametrize(("kernel", "reach"), [("box", 0), ("linear", 1), ("cubic", 2)])
def test_dead_pixels_are_filled_from_their_neighbors(kernel, reach):
    mask = np.zeros((18, 18), bool)
    mask[2 * (4 - reach) : 2 * (5 + reach), 2 * (4 - reach) : 2 * (5 + reach)] = True
    sensor = jl.Sensor(oversampling=2, frames=30, kernel=kernel, mask=mask)
    bits = sensor.expose(scene(9, 9), rng=11)
    with pytest.warns(jl.JotlightWarning, match="1 of 81 pixels") as caught:
        estimate = jl.mle_iterative(bits, sensor)
    assert len(caught) == 1
    neighbors = np.delete(estimate[3:6, 3:6].ravel(), 4)
    assert estimate[4, 4] == pytest.approx(neighbors.mean(), rel=1e-6)


def test_the_dead_pixels_of_a_signal_are_filled():
    trials = np.full(160, 20)
    trials[40:80] = 0
    ones = np.minimum(np.random.default_rng(3).binomial(20, 0.5, 160), trials)
    light = jl.operators.spread((40,), 4, "cubic", gain=4.0)
    with pytest.warns(jl.JotlightWarning, match="6 of 40 pixels"):
        signal = jl.mle_iterative(jl.Problem(light, jl.Likelihood(ones, trials)))
    assert signal.shape == (40,)
    assert np.isfinite(signal).all()


@pytest.fixture(scope="module")
def photographs(data):
    files = sorted((data / "bsds300" / "test").glob("*.jpg"))[:3]
    assert len(files) == 3
    return [read_image(file, gray=True)[100:196, 100:196] for file in files]


@pytest.mark.slow
def test_the_light_on_the_jots_is_closer_to_the_truth_than_that_of_the_closed_form(photographs):
    sensor = jl.Sensor(oversampling=4, frames=4, kernel="cubic")
    for seed, photograph in enumerate(photographs):
        bits = sensor.expose(photograph, rng=seed)
        ones = bits.to_array().sum(axis=0)
        truth = sensor.rate(photograph).astype(float)
        closed_form = jl.mle(bits.counts(4), sensor.replace(kernel="box"))
        iterated = sensor.rate(jl.mle_iterative(bits, sensor)).astype(float)
        blocks = np.kron(closed_form, np.ones((4, 4))).astype(float)
        assert np.mean((iterated - truth) ** 2) < np.mean((blocks - truth) ** 2)

        def likelihood(light, ones=ones):
            return np.sum(ones * np.log(-np.expm1(-light)) - (4 - ones) * light)

        assert likelihood(iterated) > likelihood(sensor.rate(closed_form).astype(float))


@pytest.mark.parametrize("threshold", [1, 2])
@pytest.mark.parametrize("dark", [0.0, 1e-30, 1e-7, 1e-5, 1e-3, 0.1])
def test_a_start_without_light_ends_at_the_same_estimate(threshold, dark):
    sensor = jl.Sensor(oversampling=4, frames=4, dark_counts=dark, threshold=threshold)
    image = 0.05 + 0.9 * np.kron(np.random.default_rng(3).random((4, 4)), np.ones((4, 4)))
    bits = sensor.expose(image, rng=1)
    estimate = jl.mle_iterative(bits, sensor, start=np.zeros((16, 16)))
    np.testing.assert_allclose(estimate, jl.mle(bits, sensor), rtol=0, atol=1e-5)


def test_an_unknown_solver_is_refused():
    with pytest.raises(ValueError, match="one of newton, gradient, got 'secant'"):
        jl.mle_iterative([[1]], jl.Sensor(), solver="secant")


def test_images_that_no_step_improves_end_with_their_start(monkeypatch):
    monkeypatch.setattr("jotlight.estimators.mle_iterative._MAX_HALVINGS", 0)
    sensor = jl.Sensor(oversampling=2, frames=6, kernel="quadratic")
    light = np.random.default_rng(0).random((16, 20))
    stack = [sensor.expose(image, rng=1) for image in (light, 0 * light)]
    start = np.full((2, 16, 20), 0.4)
    with pytest.warns(jl.JotlightWarning, match="rounding hides the progress of any step"):
        found, (of_light, of_darkness) = jl.mle_iterative(stack, start=start, return_history=True)
    assert not of_light.converged
    assert np.median(found[0]) == np.float32(0.4)
    # Dark images have the estimate 0 from the beginning.
    assert of_darkness.converged
    assert (found[1] == 0).all()
