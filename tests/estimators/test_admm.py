import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import jotlight as jl
from jotlight.estimators import admm
from jotlight.images.io import read_image
from reference import iterative

NORMS = ["isotropic", "anisotropic"]


def scene(height, width):
    rows, columns = np.mgrid[:height, :width]
    waves = 0.45 + 0.35 * np.sin(columns / 3) * np.cos(rows / 4)
    return np.where(columns > 0.6 * width, 0.3, 1) * waves


def run(data, sensor=None, **options):
    """The picture, its history, and the estimates in float64, one for each iteration."""
    images = []
    picture, history = jl.admm_tv(
        data,
        sensor,
        callback=lambda step: images.append(step.estimate.copy()),
        return_history=True,
        **options,
    )
    return picture, history, images


SENSOR = jl.Sensor(oversampling=4)
BITS = SENSOR.expose(scene(16, 16), rng=0)
COST = iterative.by_pixel(iterative.cost_of(BITS, SENSOR), (16, 16))
WEIGHTS = [0.5, 3.0, 10.0, "map", "automatic"]


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("weight", WEIGHTS)
def test_cvxpy_finds_nothing_better(weight, norm):
    if weight == "map":
        weight = np.random.default_rng(0).uniform(0, 6, (16, 16)) * (scene(16, 16) > 0.2)
    given = None if isinstance(weight, str) else weight
    picture, history, _ = run(BITS, SENSOR, weight=given, norm=norm, tol=1e-4)
    image, least = iterative.least_variation(COST, (16, 16), history.weight, norm)
    assert history.objective == pytest.approx(least, rel=2e-5)
    assert COST(picture) + iterative.variation(picture, norm, history.weight) == pytest.approx(
        history.objective, rel=1e-6
    )
    np.testing.assert_allclose(picture, image, atol=5e-3)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize(
    ("kernel", "oversampling", "frames"),
    [("linear", 2, 2), ("linear", 3, 1), ("quadratic", 3, 2), ("cubic", 3, 2), ("cubic", 4, 1)],
)
def test_cvxpy_finds_nothing_better_for_a_smooth_kernel(kernel, oversampling, frames, norm):
    sensor = jl.Sensor(oversampling=oversampling, frames=frames, kernel=kernel)
    bits = sensor.expose(scene(8, 9), rng=0)
    cost = iterative.cost_of(bits, sensor)
    _, history, _ = run(bits, sensor, weight=2.0, norm=norm, tol=1e-4, max_iter=2000)
    _, least = iterative.least_variation(cost, (8, 9), 2.0, norm)
    assert history.objective == pytest.approx(least, rel=1e-4)


@pytest.mark.parametrize("norm", NORMS)
def test_the_balance_of_the_penalties_comes_to_rest(norm):
    sensor = jl.Sensor(oversampling=2, frames=2, kernel="cubic")
    bits = sensor.expose(scene(8, 8), rng=0)
    _, history, _ = run(bits, sensor, weight=3.0, norm=norm, tol=1e-4, max_iter=1000)
    _, least = iterative.least_variation(iterative.cost_of(bits, sensor), (8, 8), 3.0, norm)
    assert history.objective == pytest.approx(least, rel=1e-4)


def test_cvxpy_finds_no_better_signal():
    matrix = 3.0 * iterative.spread_matrix((20,), "quadratic", 3)
    light = jl.operators.spread((20,), oversampling=3, kernel="quadratic", gain=3.0)
    steps = np.where(np.arange(20) < 12, 0.3, 0.7)
    ones = np.random.default_rng(1).binomial(8, -np.expm1(-matrix @ steps))
    problem = jl.Problem(light, jl.Likelihood(ones, trials=8))
    cost = iterative.Cost(matrix, ones, np.full(60, 8))
    for norm in NORMS:
        for weight in 1.0, np.linspace(0, 4, 20):
            picture, history, _ = run(problem, weight=weight, norm=norm, tol=1e-4)
            image, least = iterative.least_variation(cost, (20,), weight, norm)
            assert (picture.shape, picture.dtype) == ((20,), np.float32)
            assert history.objective == pytest.approx(least, rel=2e-5)
            np.testing.assert_allclose(picture, image, atol=2e-2)


RNG = np.random.default_rng(2)
MASK = RNG.random((24, 26)) < 0.3
MASK[4:10, 6:12] = True
HARD = {
    "two photons": {"threshold": 2, "gain": 32.0},
    "dark counts": {"dark_counts": 0.2},
    "dark pixels": {"dark_counts": RNG.uniform(0, 0.5, (12, 13)).repeat(2, 0).repeat(2, 1)},
    "dark jots": {"dark_counts": RNG.uniform(0, 0.5, (24, 26)), "efficiency": 0.7},
    "dead jots": {"mask": MASK},
}
SMOOTH_HARD = {
    "dead": {"mask": MASK, "kernel": "quadratic"},
    "dark": {"dark_counts": 0.1, "kernel": "cubic", "threshold": 2, "gain": 32.0},
    "odd": {"oversampling": 3, "kernel": "linear", "threshold": 2, "gain": 70.0},
    "odd and dead": {"oversampling": 1, "kernel": "cubic", "mask": MASK[1::2, 1::2]},
}


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("name", HARD)
def test_a_long_run_is_optimal_and_a_short_one_nearly(name, norm):
    sensor = jl.Sensor(**{"oversampling": 2, "frames": 4} | HARD[name])
    bits = sensor.expose(scene(12, 13), rng=3)
    cost = iterative.cost_of(bits, sensor)
    options = {"weight": 2.0, "norm": norm}
    _, short, _ = run(bits, sensor, tol=1e-4, **options)
    _, long, images = run(bits, sensor, tol=1e-7, max_iter=5000, **options)
    objective = cost(images[-1]) + iterative.variation(images[-1], norm, 2.0)
    assert long.objective == pytest.approx(objective, rel=1e-6)
    assert iterative.excess(cost, images[-1], 2.0, norm) < 1e-6 * objective
    assert short.objective == pytest.approx(objective, rel=2e-5)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("name", SMOOTH_HARD)
def test_newton_finds_nothing_better_for_a_smooth_kernel(name, norm):
    sensor = jl.Sensor(**{"oversampling": 2, "frames": 4} | SMOOTH_HARD[name])
    bits = sensor.expose(scene(12, 13), rng=3)
    cost = iterative.cost_of(bits, sensor)
    _, history, images = run(bits, sensor, weight=2.0, norm=norm, tol=1e-4, max_iter=2000)
    objective = cost(images[-1]) + iterative.variation(images[-1], norm, 2.0)
    assert history.objective == pytest.approx(objective, rel=1e-6)
    assert objective == pytest.approx(iterative.polished(cost, images[-1], 2.0, norm), rel=1e-4)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("options", [{}, {"threshold": 2}, {"dark_counts": 0.1}], ids=str)
def test_without_weight_the_likelihood_decides_alone(options, norm):
    sensor = jl.Sensor(oversampling=2, frames=6, **options)
    bits = sensor.expose(scene(12, 13), rng=4)
    picture = jl.admm_tv(bits, sensor, weight=0, norm=norm, tol=1e-5)
    np.testing.assert_allclose(picture, jl.mle(bits, sensor), atol=1e-3)


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("kernel", ["box", "linear"])
@pytest.mark.parametrize("threshold", [1, 2])
def test_a_huge_weight_leaves_the_most_likely_even_picture(threshold, kernel, norm):
    sensor = jl.Sensor(oversampling=2, frames=3, kernel=kernel, threshold=threshold)
    bits = sensor.expose(scene(12, 13), rng=5)
    cost = iterative.cost_of(bits, sensor)
    even = minimize_scalar(lambda level: cost(np.full(156, level)), (0.1, 0.9)).x
    picture = jl.admm_tv(bits, sensor, weight=1e4, norm=norm, tol=1e-4)
    np.testing.assert_allclose(picture, even, rtol=2e-3)


@pytest.mark.parametrize("mask", [None, np.eye(64, dtype=bool)])
def test_with_a_box_single_jots_are_not_looked_at(mask, monkeypatch):
    sensor = SENSOR.replace(mask=mask)
    asked, counts = [], jl.Bits.counts

    def recorded(bits, oversampling=None, **options):
        asked.append(oversampling)
        return counts(bits, oversampling, **options)

    monkeypatch.setattr(jl.Bits, "counts", recorded)
    monkeypatch.delattr(jl.Bits, "to_array")
    jl.admm_tv(BITS, sensor)
    assert set(asked) == {4}


def test_bits_and_their_counts_give_one_picture():
    np.testing.assert_array_equal(jl.admm_tv(BITS, SENSOR), jl.admm_tv(BITS.counts(4), SENSOR))


@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize("norm", NORMS)
def test_every_estimate_is_between_0_and_the_most(kernel, norm):
    sensor = jl.Sensor(oversampling=2, kernel=kernel, max_intensity=0.6)
    picture, _, images = run(sensor.expose(scene(12, 16), rng=6), sensor, weight=0.7, norm=norm)
    assert min(image.min() for image in images) == 0
    assert max(image.max() for image in images) == 0.6
    assert 0 <= picture.min() <= picture.max() <= np.float32(0.6)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
@pytest.mark.parametrize("tol", [1e-2, 1e-3])
def test_the_history_tells_how_it_went(kernel, tol):
    sensor = jl.Sensor(oversampling=4, frames=2, kernel=kernel)
    bits = sensor.expose(scene(16, 16), rng=7)
    picture, history, images = run(bits, sensor, weight=4.0, tol=tol)
    primal, dual = history.residuals["primal"], history.residuals["dual"]
    assert history.converged
    assert history.iterations == len(primal) == len(dual) == len(images)
    done = (primal <= tol) & (dual <= 10 * tol)
    assert done.nonzero()[0].tolist() == [history.iterations - 1]
    assert history.weight == 4.0
    np.testing.assert_array_equal(picture, images[-1].astype(np.float32))
    objective = iterative.cost_of(bits, sensor)(images[-1])
    objective += iterative.variation(images[-1], "isotropic", 4.0)
    # There light below a millionth of the brightest counts as that.
    assert history.objective == pytest.approx(objective, rel=1e-6)


def test_a_callback_is_told_where_the_run_stands_and_may_end_it():
    steps = []

    def watch(step):
        steps.append(step)
        assert not step.estimate.flags.writeable
        if step.number == 4:
            raise StopIteration

    picture, history = jl.admm_tv(
        BITS, SENSOR, callback=watch, return_history=True, tol=1e-5, max_iter=77
    )
    assert [step.number for step in steps] == [1, 2, 3, 4]
    assert {(step.tol, step.max_iter) for step in steps} == {(1e-5, 77)}
    worst = np.maximum(history.residuals["primal"], history.residuals["dual"] / 10)
    np.testing.assert_allclose([step.residual for step in steps], worst, rtol=1e-12)
    assert (history.converged, history.iterations) == (False, 4)
    np.testing.assert_array_equal(picture, steps[-1].estimate.astype(np.float32))


def test_too_few_iterations_are_warned_of():
    message = "admm_tv: not converged after 2 iterations.*primal.*dual.*tol = 0.001"
    with pytest.warns(jl.JotlightWarning, match=message) as caught:
        _, history = jl.admm_tv(BITS, SENSOR, max_iter=2, return_history=True)
    assert len(caught) == 1
    assert (history.converged, history.iterations) == (False, 2)


@pytest.mark.parametrize(
    ("name", "value"), [("INITIAL_PENALTY", 0.6), ("INITIAL_PENALTY", 60.0), ("BALANCE_INTERVAL", 3), ("BALANCE_INTERVAL", 10**9)]
)
@pytest.mark.parametrize("kernel", ["box", "linear"])
def test_how_the_penalties_are_chosen_does_not_change_the_answer(kernel, name, value, monkeypatch):
    sensor = jl.Sensor(oversampling=4, frames=2, kernel=kernel)
    bits = sensor.expose(scene(16, 16), rng=8)
    options = {"weight": 5.0, "tol": 1e-4, "max_iter": 2000}
    expected, usual, _ = run(bits, sensor, **options)
    monkeypatch.setattr(admm, name, value)
    picture, other, _ = run(bits, sensor, **options)
    assert other.objective == pytest.approx(usual.objective, rel=2e-5)
    np.testing.assert_allclose(picture, expected, atol=1e-2)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
def test_a_start_near_the_end_saves_iterations(kernel):
    sensor = jl.Sensor(oversampling=4, kernel=kernel)
    bits = sensor.expose(scene(24, 24), rng=9)
    picture, history, _ = run(bits, sensor, tol=1e-4)
    start = picture.copy()
    _, resumed, _ = run(bits, sensor, start=start, tol=1e-4)
    assert resumed.iterations < history.iterations
    assert resumed.objective == pytest.approx(history.objective, rel=2e-5)
    np.testing.assert_array_equal(start, picture)


def test_the_start_does_not_matter():
    start = np.random.default_rng(10).uniform(-1, 3, (16, 16))
    _, there, _ = run(BITS, SENSOR, start=start, tol=1e-4)
    _, here, _ = run(BITS, SENSOR, tol=1e-4)
    assert there.objective == pytest.approx(here.objective, rel=2e-5)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
def test_colours_do_not_mix(kernel):
    sensor = jl.Sensor(oversampling=2, frames=4, kernel=kernel, mask=np.eye(16, 20, dtype=bool))
    bits = sensor.expose(np.dstack([scene(8, 10), 0.3 * scene(8, 10)]), rng=11)
    start = np.random.default_rng(11).uniform(0.2, 0.8, (8, 10, 2))
    picture, histories = jl.admm_tv(bits, sensor, start=start, return_history=True)
    assert (picture.shape, len(histories)) == ((8, 10, 2), 2)
    for channel in range(2):
        one = jl.Bits.from_array(bits.to_array()[..., channel])
        alone, history, _ = run(one, sensor, start=start[..., channel])
        np.testing.assert_array_equal(picture[..., channel], alone)
        np.testing.assert_array_equal(histories[channel].weight, history.weight)
        assert histories[channel].objective == history.objective


@pytest.mark.parametrize(("kernel", "norm"), [("box", "isotropic"), ("cubic", "anisotropic")])
def test_the_number_of_threads_does_not_matter(kernel, norm):
    sensor = jl.Sensor(oversampling=4, kernel=kernel)
    bits = sensor.expose(scene(61, 67), rng=12)
    pictures = [jl.admm_tv(bits, sensor, norm=norm, tol=2e-2, threads=n) for n in (1, 2, 7)]
    np.testing.assert_array_equal(pictures[1], pictures[0])
    np.testing.assert_array_equal(pictures[2], pictures[0])


@pytest.mark.parametrize("norm", NORMS)
def test_blind_pixels_are_what_total_variation_says(norm):
    mask = np.zeros((48, 48), bool)
    mask[16:32, 12:24] = True
    sensor = jl.Sensor(oversampling=4, frames=2, mask=mask)
    bits = sensor.expose(np.full((12, 12), 0.4) + 0.3 * (np.arange(12) > 5), rng=13)
    cost = iterative.by_pixel(iterative.cost_of(bits, sensor), (12, 12))
    assert (cost.trials == 0).sum() == 12
    picture, history, _ = run(bits, sensor, weight=4.0, norm=norm, tol=1e-4)
    _, least = iterative.least_variation(cost, (12, 12), 4.0, norm)
    assert history.objective == pytest.approx(least, rel=2e-5)
    around = picture[3:9, 2:7].copy()
    around[1:-1, 1:-1] = np.nan
    assert np.nanmin(around) - 1e-3 < picture[4:8, 3:6].min()
    assert picture[4:8, 3:6].max() < np.nanmax(around) + 1e-3


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
def test_turned_data_give_a_turned_picture(turn, weight, kernel):
    sensor = jl.Sensor(oversampling=2, frames=2, kernel=kernel)
    bits = sensor.expose(scene(12, 16), rng=14).to_array()
    turned = np.stack([turn(frame) for frame in bits])
    here, there = (
        jl.admm_tv(jl.Bits.from_array(array), sensor, weight=weight, norm="anisotropic")
        for array in (bits, turned)
    )
    np.testing.assert_allclose(there, turn(here), atol=1e-5)


def automatic(counts, trials=16, norm="isotropic", **options):
    counts = np.asarray(counts)
    seen = jl.Likelihood(counts, trials=trials, **options)
    problem = jl.Problem(jl.operators.scaling(counts.shape, 1.0), seen, 4.0)
    return jl.tv.automatic_weight(problem, norm=norm)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
@pytest.mark.parametrize("unit", [1 / 64, 3.0, 255.0])
def test_the_unit_of_intensity_does_not_matter(unit, kernel):
    sensor = jl.Sensor(oversampling=4, dark_counts=0.1, kernel=kernel)
    bits = jl.Bits(sensor.expose(scene(16, 16), rng=15).packed)
    other = sensor.replace(gain=sensor.gain / unit, max_intensity=unit)
    expected, usual, _ = run(bits, sensor)
    picture, scaled, _ = run(bits, other)
    np.testing.assert_allclose(scaled.weight, usual.weight / unit, rtol=1e-9)
    np.testing.assert_allclose(picture, expected * unit, rtol=1e-5, atol=1e-6 * unit)
    assert scaled.iterations == usual.iterations


def test_the_darker_a_place_the_larger_is_its_weight():
    counts = np.random.default_rng(16).binomial(16, np.linspace(0.05, 0.9, 40) * np.ones((30, 1)))
    weight = automatic(counts)
    assert weight.shape == (30, 40)
    across = weight.mean(axis=0)
    assert (np.diff(across[::8]) < 0).all()
    assert across[0] > 2 * across[-1]


def test_the_same_scene_with_more_bits_is_smoothed_less_for_its_noise():
    rng = np.random.default_rng(17)
    share = -np.expm1(-scene(64, 64))
    few, many = (automatic(rng.binomial(bits, share), bits) for bits in (16, 256))
    # 1/√I is the noise, and the weight over √I what is to be smoothed in units of it.
    assert 1 < many.mean() / few.mean() < 4


@pytest.mark.parametrize("turn", [np.flipud, np.fliplr, np.rot90, np.transpose])
def test_turned_data_give_a_turned_weight(turn):
    counts = np.random.default_rng(18).binomial(16, -np.expm1(-scene(12, 16)))
    turned = automatic(np.ascontiguousarray(turn(counts)))
    np.testing.assert_allclose(turned, turn(automatic(counts)), rtol=1e-9)


def test_anisotropic_variation_weighs_less():
    counts = np.random.default_rng(18).binomial(16, 0.4, (20, 20))
    np.testing.assert_allclose(
        automatic(counts, norm="anisotropic"), np.pi / 4 * automatic(counts), rtol=1e-12
    )


@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("kernel", ["box", "linear", "cubic"])
@pytest.mark.parametrize("fill", ["zeros", "ones", "noise"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (8, 8)], ids=str)
def test_the_automatic_weight_serves_whatever_comes(shape, fill, kernel, threshold):
    sensor = jl.Sensor(oversampling=2, frames=4, kernel=kernel, threshold=threshold)
    chance = {"zeros": 0.0, "ones": 1.0, "noise": 0.3}[fill]
    jots = (4, 2 * shape[0], 2 * shape[1])
    bits = jl.Bits.from_array(np.random.default_rng(19).random(jots) < chance)
    picture, history, _ = run(bits, sensor)
    assert history.weight.shape == picture.shape == shape
    assert np.isfinite(history.weight).all()
    assert (history.weight > 0).all()
    if fill != "noise":
        np.testing.assert_allclose(picture, chance, atol=0.05)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
def test_the_automatic_weight_serves_where_jots_are_dead(kernel):
    mask = np.random.default_rng(20).random((32, 32)) < 0.4
    mask[8:24, 8:16] = True
    sensor = jl.Sensor(oversampling=2, frames=4, kernel=kernel, mask=mask)
    picture, history, _ = run(sensor.expose(np.full((16, 16), 0.5), rng=21), sensor)
    assert np.isfinite(history.weight).all()
    assert (history.weight > 0).all()
    assert np.abs(picture - 0.5).mean() < 0.08


@pytest.fixture(scope="module")
def photographs(data):
    files = sorted((data / "bsds300" / "test").glob("*.jpg"))[:20]
    assert len(files) == 20
    return [read_image(file, gray=True) for file in files]


def test_photographs_at_16_bits_a_pixel(photographs):
    decibels = []
    for index, photograph in enumerate(photographs):
        picture = jl.admm_tv(SENSOR.expose(photograph, rng=index), SENSOR)
        decibels.append(jl.metrics.psnr(picture, photograph))
    assert np.mean(decibels) > 24.7


FOUR = jl.Sensor(oversampling=2)
SMOOTH = FOUR.replace(kernel="cubic")
VARIED = FOUR.replace(dark_counts=np.linspace(0, 1, 64).reshape(8, 8))
EYE = jl.Bits.from_array(np.eye(8, dtype=bool))
COLOUR = np.ones((4, 4, 3), int)
PROBLEM = jl.Problem(jl.operators.spread((4,)), jl.Likelihood([0, 1, 1, 0]))


@pytest.mark.parametrize(
    ("data", "sensor", "options", "error", "message"),
    [
        (EYE, FOUR, {"weight": -1}, ValueError, "weight: expected .* 0 or more, got -1"),
        (EYE, FOUR, {"weight": np.nan}, ValueError, "weight: expected finite .*, got nan"),
        (EYE, FOUR, {"weight": np.inf}, ValueError, "weight: expected finite .*, got inf"),
        (EYE, FOUR, {"weight": np.full((4, 4), -2.0)}, ValueError, "weight: .*, got -2"),
        (EYE, FOUR, {"weight": np.ones((4, 5))}, ValueError, r"\(4, 4\), got .*\(4, 5\)"),
        (EYE, FOUR, {"weight": np.ones(4)}, ValueError, r"weight: .*\(4, 4\), got .*\(4,\)"),
        (COLOUR, FOUR, {"weight": np.ones((4, 4, 3))}, ValueError, r"weight: .*\(4, 4, 3\)"),
        (PROBLEM, None, {"weight": np.ones(5)}, ValueError, r"weight: .*\(4,\), got .*\(5,\)"),
        (EYE, FOUR, {"weight": "strong"}, ValueError, "weight: expected a number, .* got <U6"),
        (EYE, FOUR, {"weight": []}, ValueError, r"weight: expected .*\(0,\)"),
        (EYE, FOUR, {"norm": "l1"}, ValueError, "one of isotropic, anisotropic, got 'l1'"),
        (EYE, FOUR, {"tol": 0}, ValueError, "tol: expected a finite number above 0, got 0"),
        (EYE, FOUR, {"tol": -1}, ValueError, "tol: expected a finite number above 0, got -1"),
        (EYE, FOUR, {"tol": np.inf}, ValueError, "tol: expected a finite .*, got inf"),
        (EYE, FOUR, {"tol": np.nan}, ValueError, "tol: expected a finite .*, got nan"),
        (EYE, FOUR, {"max_iter": 0}, ValueError, "max_iter: expected 1 or more, got 0"),
        (EYE, FOUR, {"max_iter": 1.5}, TypeError, "max_iter: expected a whole number, got 1.5"),
        (EYE, FOUR, {"start": np.zeros((4, 5))}, ValueError, r"\(4, 4\), got \(4, 5\)"),
        (EYE, FOUR, {"start": np.zeros((4, 4, 3))}, ValueError, r"start: .*got .*\(4, 4, 3\)"),
        (EYE, FOUR, {"start": np.ones((4, 4), int)}, TypeError, "expected floats .* got int64"),
        (EYE, FOUR, {"start": np.full((4, 4), np.nan)}, ValueError, "start: .* got NaN"),
        (EYE, None, {}, TypeError, "sensor: expected a jotlight.Sensor, got NoneType"),
        (PROBLEM, FOUR, {}, TypeError, "sensor: expected none, since a Problem has its own"),
        (PROBLEM, None, {"start": np.zeros(5)}, ValueError, r"shape \(4,\), got \(5,\)"),
        (np.ones((4, 4), int), SMOOTH, {}, ValueError, "cubic kernel .* the bits are needed"),
        (np.ones((4, 4), int), VARIED, {}, ValueError, "dark counts the bits are needed"),
        (
            FOUR.expose(scene(4, 4), rng=0),
            SMOOTH,
            {},
            ValueError,
            "kernel: expected 'box', with which the bits were made, got 'cubic'",
        ),
        (
            EYE,
            SMOOTH.replace(mask=np.ones((8, 8), bool)),
            {},
            ValueError,
            "mask: expected at least one jot that is alive, got none",
        ),
    ],
)
def test_what_does_not_fit_is_refused(data, sensor, options, error, message):
    with pytest.raises(error, match=message):
        jl.admm_tv(data, sensor, **options)


@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize("gain", [3200.0, 1e5, 1e7])
def test_a_glaring_scene_gives_a_picture_too(kernel, gain):
    sensor = jl.Sensor(oversampling=2, frames=4, gain=gain, kernel=kernel)
    picture = jl.admm_tv(sensor.expose(np.full((16, 20), 0.5), rng=0), sensor)
    assert (picture > 0.5).all()
    assert (picture <= 1).all()
    assert np.ptp(picture) < 1e-3


@pytest.mark.parametrize("kernel", ["box", "quadratic", "cubic"])
def test_a_start_at_the_result_costs_nothing(kernel):
    scene = jl.datasets.photograph("camera")[100:148, 180:228]
    sensor = jl.Sensor(oversampling=4, kernel=kernel)
    bits = sensor.expose(scene, rng=0)
    picture, first = jl.admm_tv(bits, sensor, return_history=True)
    _, again = jl.admm_tv(bits, sensor, start=picture, weight=first.weight, return_history=True)
    assert again.converged
    assert again.iterations <= first.iterations
