import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import jotlight as jl
import jotlight._engine as engine
from jotlight.estimators.iterative import admm_splitting
from jotlight.images.io import read_image
from reference import iterative
from reference.iterative import scene

NORMS = ["isotropic", "anisotropic"]


def run(data, sensor=None, **options):
    return iterative.run(jl.admm_tv, data, sensor, **options)


SENSOR = jl.Sensor(oversampling=4)
BITS = SENSOR.expose(scene(16, 16), rng=0)
COST = iterative.merge_cells(iterative.build_cost(BITS, SENSOR))
WEIGHTS = [0.5, 3.0, 10.0, "map", "automatic"]


@pytest.mark.slow
@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("weight", WEIGHTS)
def test_the_objective_equals_the_minimum_that_cvxpy_finds(weight, norm):
    if weight == "map":
        weight = np.random.default_rng(0).uniform(0, 6, (16, 16)) * (scene(16, 16) > 0.2)
    chosen = None if isinstance(weight, str) else weight
    estimate, history, _ = run(BITS, SENSOR, weight=chosen, norm=norm, tol=1e-4)
    image, minimum = iterative.minimize_with_variation(COST, (16, 16), history.weight, norm)
    assert history.objective == pytest.approx(minimum, rel=2e-5)
    variation = iterative.total_variation(estimate, norm, history.weight)
    assert COST(estimate) + variation == pytest.approx(history.objective, rel=1e-6)
    np.testing.assert_allclose(estimate, image, atol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize(
    ("kernel", "oversampling", "frames"),
    [("linear", 2, 2), ("linear", 3, 1), ("quadratic", 3, 2), ("cubic", 3, 2), ("cubic", 4, 1)],
)
def test_for_smooth_kernels_the_objective_equals_the_minimum_that_cvxpy_finds(
    kernel, oversampling, frames, norm
):
    sensor = jl.Sensor(oversampling=oversampling, frames=frames, kernel=kernel)
    bits = sensor.expose(scene(8, 9), rng=0)
    cost = iterative.build_cost(bits, sensor)
    _, history, _ = run(bits, sensor, weight=2.0, norm=norm, tol=1e-4, max_iter=2000)
    _, minimum = iterative.minimize_with_variation(cost, (8, 9), 2.0, norm)
    assert history.objective == pytest.approx(minimum, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("norm", NORMS)
def test_the_adjustment_of_the_penalties_settles_and_the_run_converges(norm):
    sensor = jl.Sensor(oversampling=2, frames=2, kernel="cubic")
    bits = sensor.expose(scene(8, 8), rng=0)
    _, history, _ = run(bits, sensor, weight=3.0, norm=norm, tol=1e-4, max_iter=1000)
    cost = iterative.build_cost(bits, sensor)
    _, minimum = iterative.minimize_with_variation(cost, (8, 8), 3.0, norm)
    assert history.objective == pytest.approx(minimum, rel=1e-4)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("weight", [1.0, np.linspace(0, 4, 20)], ids=["number", "map"])
def test_a_signal_has_the_minimum_that_cvxpy_finds(weight, norm):
    matrix = 3.0 * iterative.spread_matrix((20,), "quadratic", 3)
    light = jl.operators.spread((20,), oversampling=3, kernel="quadratic", gain=3.0)
    steps = np.where(np.arange(20) < 12, 0.3, 0.7)
    ones = np.random.default_rng(1).binomial(8, -np.expm1(-matrix @ steps))
    problem = jl.Problem(light, jl.Likelihood(ones, trials=8))
    cost = iterative.Cost(matrix, ones, np.full(60, 8))
    estimate, history, _ = run(problem, weight=weight, norm=norm, tol=1e-4)
    signal, minimum = iterative.minimize_with_variation(cost, (20,), weight, norm)
    assert (estimate.shape, estimate.dtype) == ((20,), np.float32)
    assert history.objective == pytest.approx(minimum, rel=2e-5)
    np.testing.assert_allclose(estimate, signal, atol=2e-2)


RNG = np.random.default_rng(2)
MASK = RNG.random((24, 26)) < 0.3
MASK[4:10, 6:12] = True
BOX_SENSORS = {
    "two photons": {"threshold": 2, "gain": 32.0},
    "dark counts": {"dark_counts": 0.2},
    "dark counts per pixel": {
        "dark_counts": RNG.uniform(0, 0.5, (12, 13)).repeat(2, 0).repeat(2, 1)
    },
    "dark counts per jot": {"dark_counts": RNG.uniform(0, 0.5, (24, 26)), "efficiency": 0.7},
    "dead jots": {"mask": MASK},
}
SMOOTH_SENSORS = {
    "dead jots": {"mask": MASK, "kernel": "quadratic"},
    "dark counts": {"dark_counts": 0.1, "kernel": "cubic", "threshold": 2, "gain": 32.0},
    "asymmetric": {"oversampling": 3, "kernel": "linear", "threshold": 2, "gain": 70.0},
    "asymmetric and dead": {"oversampling": 1, "kernel": "cubic", "mask": MASK[1::2, 1::2]},
}


@pytest.mark.slow
@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("name", BOX_SENSORS)
def test_a_long_run_is_optimal_and_a_short_run_nearly_optimal(name, norm):
    sensor = jl.Sensor(**{"oversampling": 2, "frames": 4} | BOX_SENSORS[name])
    bits = sensor.expose(scene(12, 13), rng=3)
    cost = iterative.build_cost(bits, sensor)
    options = {"weight": 2.0, "norm": norm}
    _, short, _ = run(bits, sensor, tol=1e-4, **options)
    _, long, estimates = run(bits, sensor, tol=1e-7, max_iter=5000, **options)
    objective = cost(estimates[-1]) + iterative.total_variation(estimates[-1], norm, 2.0)
    assert long.objective == pytest.approx(objective, rel=1e-6)
    assert iterative.suboptimality_bound(cost, estimates[-1], 2.0, norm) < 1e-6 * objective
    assert short.objective == pytest.approx(objective, rel=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("name", SMOOTH_SENSORS)
def test_for_smooth_kernels_newtons_method_does_not_improve_the_objective(name, norm):
    sensor = jl.Sensor(**{"oversampling": 2, "frames": 4} | SMOOTH_SENSORS[name])
    bits = sensor.expose(scene(12, 13), rng=3)
    cost = iterative.build_cost(bits, sensor)
    _, history, estimates = run(bits, sensor, weight=2.0, norm=norm, tol=1e-4, max_iter=2000)
    objective = cost(estimates[-1]) + iterative.total_variation(estimates[-1], norm, 2.0)
    assert history.objective == pytest.approx(objective, rel=1e-6)
    refined = iterative.refined_objective(cost, estimates[-1], 2.0, norm)
    assert objective == pytest.approx(refined, rel=1e-4)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("options", [{}, {"threshold": 2}, {"dark_counts": 0.1}], ids=str)
def test_with_weight_0_the_estimate_is_the_maximum_likelihood_estimate(options, norm):
    sensor = jl.Sensor(oversampling=2, frames=6, **options)
    bits = sensor.expose(scene(12, 13), rng=4)
    estimate = jl.admm_tv(bits, sensor, weight=0, norm=norm, tol=1e-5)
    np.testing.assert_allclose(estimate, jl.mle(bits, sensor), atol=1e-3)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("kernel", ["box", "linear"])
@pytest.mark.parametrize("threshold", [1, 2])
def test_with_a_huge_weight_the_estimate_is_the_most_likely_constant(threshold, kernel, norm):
    sensor = jl.Sensor(oversampling=2, frames=3, kernel=kernel, threshold=threshold)
    bits = sensor.expose(scene(12, 13), rng=5)
    cost = iterative.build_cost(bits, sensor)
    constant = minimize_scalar(lambda level: cost(np.full(156, level)), (0.1, 0.9)).x
    estimate = jl.admm_tv(bits, sensor, weight=1e4, norm=norm, tol=1e-4)
    np.testing.assert_allclose(estimate, constant, rtol=2e-3)


@pytest.mark.parametrize("mask", [None, np.eye(64, dtype=bool)], ids=["no mask", "mask"])
def test_for_the_box_kernel_the_bits_are_only_counted_by_pixel(mask, monkeypatch):
    sensor = SENSOR.replace(mask=mask)
    requested, count = [], engine.add_block_counts

    def recorded(packed, width, oversampling, *arguments):
        requested.append(oversampling)
        return count(packed, width, oversampling, *arguments)

    monkeypatch.setattr(engine, "add_block_counts", recorded)
    monkeypatch.delattr(jl.Bits, "to_array")
    jl.admm_tv(BITS, sensor)
    assert set(requested) == {4}


@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize("norm", NORMS)
def test_the_estimate_of_every_iteration_lies_in_0_to_s(kernel, norm):
    sensor = jl.Sensor(oversampling=2, kernel=kernel, max_intensity=0.6)
    bits = sensor.expose(scene(12, 16), rng=6)
    estimate, _, estimates = run(bits, sensor, weight=0.7, norm=norm)
    assert min(image.min() for image in estimates) == 0
    assert max(image.max() for image in estimates) == 0.6
    assert 0 <= estimate.min() <= estimate.max() <= np.float32(0.6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("INITIAL_PENALTY", 0.6),
        ("BALANCE_INTERVAL", 3),
        pytest.param("INITIAL_PENALTY", 60.0, marks=pytest.mark.slow),
        pytest.param("BALANCE_INTERVAL", 10**9, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("kernel", ["box", "linear"])
def test_the_choice_of_the_penalties_does_not_change_the_estimate(kernel, name, value, monkeypatch):
    sensor = jl.Sensor(oversampling=4, frames=2, kernel=kernel)
    bits = sensor.expose(scene(16, 16), rng=8)
    options = {"weight": 5.0, "tol": 1e-4, "max_iter": 2000}
    expected, usual, _ = run(bits, sensor, **options)
    monkeypatch.setattr(admm_splitting, name, value)
    estimate, other, _ = run(bits, sensor, **options)
    assert other.objective == pytest.approx(usual.objective, rel=2e-5)
    np.testing.assert_allclose(estimate, expected, atol=1e-2)


@pytest.mark.parametrize(("kernel", "norm"), [("box", "isotropic"), ("cubic", "anisotropic")])
def test_the_number_of_threads_does_not_change_the_estimate(kernel, norm):
    sensor = jl.Sensor(oversampling=4, kernel=kernel)
    bits = sensor.expose(scene(61, 67), rng=12)
    estimates = [jl.admm_tv(bits, sensor, norm=norm, tol=2e-2, threads=n) for n in (1, 2, 7)]
    np.testing.assert_array_equal(estimates[1], estimates[0])
    np.testing.assert_array_equal(estimates[2], estimates[0])


@pytest.mark.parametrize("norm", NORMS)
def test_total_variation_determines_dead_pixels(norm):
    mask = np.zeros((48, 48), bool)
    mask[16:32, 12:24] = True
    sensor = jl.Sensor(oversampling=4, frames=2, mask=mask)
    bits = sensor.expose(np.full((12, 12), 0.4) + 0.3 * (np.arange(12) > 5), rng=13)
    cost = iterative.merge_cells(iterative.build_cost(bits, sensor))
    assert (cost.trials == 0).sum() == 12
    estimate, history, _ = run(bits, sensor, weight=4.0, norm=norm, tol=1e-4)
    _, minimum = iterative.minimize_with_variation(cost, (12, 12), 4.0, norm)
    assert history.objective == pytest.approx(minimum, rel=2e-5)
    neighbors = estimate[3:9, 2:7].copy()
    neighbors[1:-1, 1:-1] = np.nan
    assert np.nanmin(neighbors) - 1e-3 < estimate[4:8, 3:6].min()
    assert estimate[4:8, 3:6].max() < np.nanmax(neighbors) + 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize(
    ("turn", "weight"),
    [
        (np.flipud, 1.5),
        (np.fliplr, 1.5),
        (np.rot90, 1.5),
        (np.transpose, 1.5),
        (np.transpose, None),
    ],
)
def test_rotated_and_mirrored_data_give_the_rotated_and_mirrored_estimate(turn, weight, kernel):
    sensor = jl.Sensor(oversampling=2, frames=2, kernel=kernel)
    bits = sensor.expose(scene(12, 16), rng=14).to_array()
    turned = np.stack([turn(frame) for frame in bits])
    expected, estimate = (
        jl.admm_tv(jl.Bits.from_array(array), sensor, weight=weight, norm="anisotropic")
        for array in (bits, turned)
    )
    np.testing.assert_allclose(estimate, turn(expected), atol=1e-5)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
@pytest.mark.parametrize("unit", [1 / 64, 3.0, 255.0])
def test_the_unit_of_intensity_only_scales_the_estimate(unit, kernel):
    sensor = jl.Sensor(oversampling=4, dark_counts=0.1, kernel=kernel)
    bits = jl.Bits(sensor.expose(scene(16, 16), rng=15).packed)
    other = sensor.replace(gain=sensor.gain / unit, max_intensity=unit)
    expected, usual, _ = run(bits, sensor)
    estimate, scaled, _ = run(bits, other)
    np.testing.assert_allclose(scaled.weight, usual.weight / unit, rtol=1e-9)
    np.testing.assert_allclose(estimate, expected * unit, rtol=1e-5, atol=1e-6 * unit)
    assert scaled.iterations == usual.iterations


@pytest.fixture(scope="module")
def photographs(data):
    files = sorted((data / "bsds300" / "test").glob("*.jpg"))[:20]
    assert len(files) == 20
    return [read_image(file, gray=True) for file in files]


@pytest.mark.exhaustive
def test_photographs_at_16_trials_reach_the_documented_psnr(photographs):
    decibels = []
    for index, photograph in enumerate(photographs):
        estimate = jl.admm_tv(SENSOR.expose(photograph, rng=index), SENSOR)
        decibels.append(jl.metrics.psnr(estimate, photograph))
    assert np.mean(decibels) > 24.7


@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize("gain", [3200.0, 1e5, 1e7])
def test_an_overexposed_scene_has_a_bright_even_estimate(kernel, gain):
    sensor = jl.Sensor(oversampling=2, frames=4, gain=gain, kernel=kernel)
    estimate = jl.admm_tv(sensor.expose(np.full((16, 20), 0.5), rng=0), sensor)
    assert (estimate > 0.5).all()
    assert (estimate <= 1).all()
    assert np.ptp(estimate) < 1e-3


@pytest.mark.parametrize(
    ("weight", "message"),
    [
        (-1, "weight: expected .* 0 or more, got -1"),
        (np.nan, "weight: expected finite .*, got nan"),
        (np.inf, "weight: expected finite .*, got inf"),
        (np.full((4, 4), -2.0), "weight: .*, got -2"),
        (np.ones((4, 5)), r"\(4, 4\), got .*\(4, 5\)"),
        (np.ones(4), r"weight: .*\(4, 4\), got .*\(4,\)"),
        ("strong", "weight: expected a number, got 'strong'"),
        ([], r"weight: expected .*\(0,\)"),
    ],
)
def test_an_invalid_weight_is_refused(weight, message):
    bits = jl.Bits.from_array(np.eye(8, dtype=bool))
    with pytest.raises(ValueError, match=message):
        jl.admm_tv(bits, jl.Sensor(oversampling=2), weight=weight)


def test_a_weight_of_another_shape_is_refused_for_color_and_for_signals():
    sensor = jl.Sensor(oversampling=2)
    with pytest.raises(ValueError, match=r"weight: .*\(4, 4, 3\)"):
        jl.admm_tv(np.ones((4, 4, 3), int), sensor, weight=np.ones((4, 4, 3)))
    problem = jl.Problem(jl.operators.spread((4,)), jl.Likelihood([0, 1, 1, 0]))
    with pytest.raises(ValueError, match=r"weight: .*\(4,\), got .*\(5,\)"):
        jl.admm_tv(problem, weight=np.ones(5))


def test_an_unknown_norm_is_refused():
    with pytest.raises(ValueError, match="one of isotropic, anisotropic, got 'l1'"):
        jl.admm_tv(BITS, SENSOR, norm="l1")
