import numpy as np
import pytest

import jotlight as jl
from jotlight.images.io import read_image
from reference import iterative

SOLVERS = ["newton", "gradient"]


def scene(height, width):
    rows, columns = np.mgrid[:height, :width]
    waves = 0.45 + 0.35 * np.sin(columns / 3) * np.cos(rows / 4)
    return np.where(columns > 0.6 * width, 0.3, 1) * waves


def run(data, sensor=None, **options):
    """The picture, its history, and the estimates in float64, one for each iteration."""
    images = []
    picture, history = jl.mle_iterative(
        data,
        sensor,
        callback=lambda step: images.append(step.estimate.copy()),
        return_history=True,
        **options,
    )
    return picture, history, images


DARK = np.random.default_rng(0).uniform(0, 0.4, (6, 7))
MASK = np.random.default_rng(1).random((12, 14)) < 0.3
MASK[::2, ::2] = False
BOXES = {
    "plain": {},
    "efficiency": {"efficiency": 0.4, "gain": 30.0},
    "dark number": {"dark_counts": 0.2},
    "dark map": {"dark_counts": DARK.repeat(2, 0).repeat(2, 1)},
    "dark jots": {"dark_counts": np.random.default_rng(2).uniform(0, 0.4, (12, 14))},
    "dead jots": {"mask": MASK},
    "all": {"mask": MASK, "dark_counts": DARK.repeat(2, 0).repeat(2, 1), "efficiency": 0.7},
}


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("name", BOXES)
def test_of_a_box_it_is_the_closed_form(name, threshold, solver):
    sensor = jl.Sensor(oversampling=2, frames=6, threshold=threshold, **BOXES[name])
    sensor = sensor.replace(gain=sensor.gain * threshold)
    bits = sensor.expose(scene(6, 7), rng=3)
    expected = jl.mle(bits, sensor)
    assert expected.min() < 0.1 < 0.6 < expected.max()
    estimate = jl.mle_iterative(bits, sensor, solver=solver)
    np.testing.assert_allclose(estimate, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("name", ["plain", "efficiency", "dark number", "dark map"])
def test_counts_serve_for_a_box(name, threshold, solver):
    sensor = jl.Sensor(oversampling=2, frames=6, threshold=threshold, **BOXES[name])
    sensor = sensor.replace(gain=sensor.gain * threshold)
    counts = np.random.default_rng(4).integers(0, 25, (6, 7))
    counts[0, :2] = 0, 24
    estimate = jl.mle_iterative(counts, sensor, solver=solver)
    np.testing.assert_allclose(estimate, jl.mle(counts, sensor), rtol=0, atol=1e-5)


def test_bits_and_their_counts_give_one_picture():
    sensor = jl.Sensor(oversampling=4, dark_counts=0.1)
    bits = sensor.expose(scene(9, 8), rng=0)
    np.testing.assert_array_equal(
        jl.mle_iterative(bits, sensor), jl.mle_iterative(bits.counts(4), sensor)
    )


def smooth(kernel, oversampling, threshold, **options):
    most = float(threshold)
    sensor = jl.Sensor(
        oversampling=oversampling,
        frames=3,
        kernel=kernel,
        threshold=threshold,
        max_intensity=most,
        **options,
    )
    return sensor, sensor.expose(most * scene(12, 12), rng=oversampling)


@pytest.mark.parametrize(
    ("kernel", "oversampling", "threshold"),
    [
        ("linear", 2, 2),
        ("linear", 4, 1),
        ("quadratic", 2, 1),
        ("quadratic", 3, 2),
        ("cubic", 3, 2),
        ("cubic", 4, 1),
    ],
)
def test_no_image_that_scipy_finds_makes_the_bits_more_likely(kernel, oversampling, threshold):
    sensor, bits = smooth(kernel, oversampling, threshold)
    cost = iterative.cost_of(bits, sensor)
    least = cost(cost.least())
    for solver in SOLVERS:
        picture, history, images = run(bits, sensor, solver=solver, max_iter=2000)
        assert cost(images[-1]) == pytest.approx(least, rel=1e-9)
        assert cost(picture) == pytest.approx(least, rel=1e-6)
        assert history.objective == pytest.approx(cost(images[-1]), rel=1e-11)
        assert cost.projected_gradient(images[-1]) < 2e-6


@pytest.mark.parametrize("solver", SOLVERS)
def test_imperfect_jots_with_a_smooth_kernel_have_a_maximum_too(solver):
    rng = np.random.default_rng(5)
    sensor, bits = smooth(
        "quadratic",
        2,
        2,
        mask=rng.random((24, 24)) < 0.2,
        dark_counts=rng.uniform(0, 0.3, (24, 24)),
        efficiency=0.6,
    )
    cost = iterative.cost_of(bits, sensor)
    _, _, images = run(bits, sensor, solver=solver, max_iter=2000)
    assert cost(images[-1]) == pytest.approx(cost(cost.least()), rel=1e-9)
    assert cost.projected_gradient(images[-1]) < 2e-6


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 2])
def test_the_bits_become_more_likely_from_step_to_step(threshold, solver):
    sensor, bits = smooth("cubic", 3, threshold)
    cost = iterative.cost_of(bits, sensor)
    _, _, images = run(bits, sensor, solver=solver, max_iter=2000)
    costs = np.array([cost(image) for image in images])
    assert (np.diff(costs) <= 1e-12 * costs[0]).all()
    assert costs[-1] < 0.99 * costs[0]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kernel", ["linear", "quadratic", "cubic"])
def test_fewer_ones_than_pixels_have_a_maximum_too(kernel, solver):
    """The likelihood has no curvature then along some directions."""
    sensor = jl.Sensor(oversampling=2, frames=5, gain=2.0, kernel=kernel)
    for seed in range(3):
        bits = sensor.expose(scene(8, 7), rng=seed)
        assert 10 < bits.to_array().sum() < 56
        cost = iterative.cost_of(bits, sensor)
        _, _, images = run(bits, sensor, solver=solver)
        assert cost(images[-1]) == pytest.approx(cost(cost.least()), rel=1e-8)


@pytest.mark.parametrize("fill", [0, 1])
def test_bits_that_are_all_alike_give_the_darkest_or_the_brightest_picture(fill):
    sensor = jl.Sensor(oversampling=2, kernel="cubic", max_intensity=3.0)
    bits = jl.Bits.from_array(np.full((1, 10, 12), fill))
    np.testing.assert_array_equal(jl.mle_iterative(bits, sensor), 3.0 * fill)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 3])
def test_a_signal_is_a_problem_of_its_own(threshold, solver):
    matrix = 3.0 * iterative.spread_matrix((15,), "cubic", 3)
    light = jl.operators.spread((15,), oversampling=3, kernel="cubic", gain=3.0)
    ones = np.random.default_rng(6).binomial(20, np.linspace(0.2, 0.7, 45))
    problem = jl.Problem(light, jl.Likelihood(ones, trials=20, threshold=threshold), 5.0)
    picture, history, images = run(problem, solver=solver, max_iter=2000)
    cost = iterative.Cost(matrix, ones, 20, threshold, most=5.0)
    assert (picture.shape, picture.dtype) == ((15,), np.float32)
    assert history.objective == pytest.approx(cost(cost.least()), rel=1e-9)
    assert cost.projected_gradient(images[-1]) < 2e-6


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("threshold", [1, 2])
def test_an_operator_may_be_made_by_the_user(threshold, solver):
    rng = np.random.default_rng(7)
    matrix = rng.exponential(1, (200, 12)) * (rng.random((200, 12)) < 0.3)
    own = jl.operators.Operator(
        lambda image: matrix @ image.ravel(),
        lambda light: (matrix.T @ light).reshape(3, 4),
        (3, 4),
        (200,),
    )
    dark = rng.uniform(0, 0.2, 200)
    ones = rng.binomial(5, -np.expm1(-matrix @ rng.uniform(0, 1, 12) - dark))
    seen = jl.Likelihood(ones, trials=5, threshold=threshold, dark_counts=dark)
    picture, history, images = run(jl.Problem(own, seen, 2.0), solver=solver, max_iter=2000)
    cost = iterative.Cost(matrix, ones, 5, threshold, dark, most=2.0)
    assert picture.shape == (3, 4)
    assert history.objective == pytest.approx(cost(cost.least()), rel=1e-9)
    assert cost.projected_gradient(images[-1]) < 2e-6


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
def test_colours_do_not_mix(kernel):
    sensor = jl.Sensor(oversampling=2, frames=4, kernel=kernel, mask=np.eye(16, 20, dtype=bool))
    bits = sensor.expose(np.dstack([scene(8, 10), 1 - scene(8, 10)]), rng=8)
    start = np.random.default_rng(8).uniform(0.2, 0.8, (8, 10, 2))
    picture, histories = jl.mle_iterative(bits, sensor, start=start, return_history=True)
    assert (picture.shape, len(histories)) == ((8, 10, 2), 2)
    for channel in range(2):
        alone, history = jl.mle_iterative(
            jl.Bits.from_array(bits.to_array()[..., channel]),
            sensor,
            start=start[..., channel],
            return_history=True,
        )
        np.testing.assert_array_equal(picture[..., channel], alone)
        assert histories[channel].objective == history.objective
        assert histories[channel].iterations == history.iterations


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_history_tells_how_it_went(solver):
    sensor, bits = smooth("linear", 3, 1)
    picture, history, images = run(bits, sensor, solver=solver, tol=1e-5)
    (residuals,) = history.residuals.values()
    assert history.converged
    assert history.iterations == len(residuals) == len(images)
    assert residuals[-1] <= 1e-5 < residuals[:-1].min()
    assert history.weight == 0
    np.testing.assert_array_equal(picture, images[-1].astype(np.float32))
    cost = iterative.cost_of(bits, sensor)
    assert residuals[-1] == pytest.approx(cost.projected_gradient(images[-1]), rel=1e-6)
    assert history.objective == pytest.approx(cost(images[-1]), rel=1e-11)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_smaller_tolerance_comes_nearer(solver):
    sensor, bits = smooth("quadratic", 2, 1)
    cost = iterative.cost_of(bits, sensor)
    runs = [run(bits, sensor, solver=solver, tol=10.0**-power) for power in (2, 4, 6)]
    costs = [cost(images[-1]) for *_, images in runs]
    assert costs[0] > costs[1] > costs[2]
    assert runs[0][1].iterations < runs[1][1].iterations < runs[2][1].iterations


def test_a_callback_is_told_where_the_run_stands_and_may_end_it():
    sensor, bits = smooth("cubic", 2, 1)
    steps = []

    def watch(step):
        steps.append(step)
        assert not step.estimate.flags.writeable
        if step.number == 4:
            raise StopIteration

    picture, history = jl.mle_iterative(
        bits, sensor, callback=watch, return_history=True, tol=1e-5, max_iter=77
    )
    assert [step.number for step in steps] == [1, 2, 3, 4]
    assert {(step.tol, step.max_iter) for step in steps} == {(1e-5, 77)}
    assert [step.residual for step in steps] == list(history.residuals["projected gradient"])
    assert (history.converged, history.iterations) == (False, 4)
    np.testing.assert_array_equal(picture, steps[-1].estimate.astype(np.float32))


def test_an_error_in_a_callback_comes_through():
    def stumble(step):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        jl.mle_iterative([[2]], jl.Sensor(frames=4), callback=stumble)


@pytest.mark.parametrize("solver", SOLVERS)
def test_too_few_iterations_are_warned_of(solver):
    sensor, bits = smooth("cubic", 2, 1)
    with pytest.warns(jl.JotlightWarning, match="not converged after 1 iteration") as caught:
        picture, history = jl.mle_iterative(
            bits, sensor, solver=solver, max_iter=1, return_history=True
        )
    assert len(caught) == 1
    assert (history.converged, history.iterations) == (False, 1)
    assert (picture >= 0).all()
    assert (picture <= 1).all()


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_start_near_the_end_saves_iterations(solver):
    sensor, bits = smooth("quadratic", 3, 1)
    picture, history, _ = run(bits, sensor, solver=solver)
    again, resumed, _ = run(bits, sensor, solver=solver, start=picture)
    assert resumed.iterations < history.iterations / 2
    assert resumed.objective == pytest.approx(history.objective, rel=1e-9)
    np.testing.assert_allclose(again, picture, atol=1e-3)


def test_the_start_does_not_matter_and_is_cut_to_what_is_possible():
    sensor, bits = smooth("linear", 2, 1)
    start = np.random.default_rng(9).uniform(-1, 3, (12, 12))
    before = start.copy()
    _, there, images = run(bits, sensor, start=start)
    _, here, _ = run(bits, sensor)
    assert 0 <= images[0].min() <= images[0].max() <= 1
    assert there.objective == pytest.approx(here.objective, rel=1e-9)
    np.testing.assert_array_equal(start, before)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kernel", ["box", "cubic"])
def test_the_number_of_threads_does_not_matter(kernel, solver):
    sensor = jl.Sensor(oversampling=4, frames=2, kernel=kernel)
    bits = sensor.expose(scene(47, 51), rng=10)
    pictures = [
        jl.mle_iterative(bits, sensor, solver=solver, tol=1e-2, threads=threads)
        for threads in (1, 2, 7)
    ]
    np.testing.assert_array_equal(pictures[1], pictures[0])
    np.testing.assert_array_equal(pictures[2], pictures[0])


@pytest.mark.parametrize(("kernel", "reach"), [("box", 0), ("linear", 1), ("cubic", 2)])
def test_blind_pixels_are_filled_from_their_neighbours(kernel, reach):
    mask = np.zeros((18, 18), bool)
    mask[2 * (4 - reach) : 2 * (5 + reach), 2 * (4 - reach) : 2 * (5 + reach)] = True
    sensor = jl.Sensor(oversampling=2, frames=30, kernel=kernel, mask=mask)
    bits = sensor.expose(scene(9, 9), rng=11)
    with pytest.warns(jl.JotlightWarning, match="1 of 81 pixels") as caught:
        picture = jl.mle_iterative(bits, sensor)
    assert len(caught) == 1
    neighbours = np.delete(picture[3:6, 3:6].ravel(), 4)
    assert picture[4, 4] == pytest.approx(neighbours.mean(), rel=1e-6)


@pytest.fixture(scope="module")
def photographs(data):
    files = sorted((data / "bsds300" / "test").glob("*.jpg"))[:3]
    assert len(files) == 3
    return [read_image(file, gray=True)[100:196, 100:196] for file in files]


def test_it_knows_the_light_on_the_jots_better_than_the_closed_form(photographs):
    sensor = jl.Sensor(oversampling=4, frames=4, kernel="cubic")
    for seed, photograph in enumerate(photographs):
        bits = sensor.expose(photograph, rng=seed)
        jots = bits.to_array().sum(axis=0)
        truth = sensor.rate(photograph).astype(float)
        boxes = jl.mle(bits.counts(4), sensor.replace(kernel="box"))
        iterated = sensor.rate(jl.mle_iterative(bits, sensor)).astype(float)
        closed = np.kron(boxes, np.ones((4, 4))).astype(float)
        assert np.mean((iterated - truth) ** 2) < np.mean((closed - truth) ** 2)

        def likelihood(light, jots=jots):
            return np.sum(jots * np.log(-np.expm1(-light)) - (4 - jots) * light)

        assert likelihood(iterated) > likelihood(sensor.rate(boxes).astype(float))


SENSOR = jl.Sensor(oversampling=2)
SMOOTH = SENSOR.replace(kernel="cubic")
BITS = jl.Bits.from_array(np.eye(8, dtype=bool))
VARIED = SENSOR.replace(dark_counts=np.linspace(0, 1, 64).reshape(8, 8))
PROBLEM = jl.Problem(jl.operators.spread((4,)), jl.Likelihood([0, 1, 1, 0]))


@pytest.mark.parametrize(
    ("data", "sensor", "options", "error", "message"),
    [
        (BITS, SENSOR, {"solver": "secant"}, ValueError, "one of newton, gradient, got 'secant'"),
        (BITS, SENSOR, {"tol": 0}, ValueError, "tol: expected a finite number above 0, got 0"),
        (BITS, SENSOR, {"tol": -1}, ValueError, "tol: expected a finite number above 0, got -1"),
        (BITS, SENSOR, {"tol": np.inf}, ValueError, "tol: expected a finite .*, got inf"),
        (BITS, SENSOR, {"tol": np.nan}, ValueError, "tol: expected a finite .*, got nan"),
        (BITS, SENSOR, {"max_iter": 0}, ValueError, "max_iter: expected 1 or more, got 0"),
        (BITS, SENSOR, {"max_iter": 1.5}, TypeError, "max_iter: expected a whole number, got 1.5"),
        (BITS, SENSOR, {"start": np.zeros((4, 5))}, ValueError, r"\(4, 4\), got \(4, 5\)"),
        (BITS, SENSOR, {"start": np.zeros((4, 4, 3))}, ValueError, r"start: .*got .*\(4, 4, 3\)"),
        (BITS, SENSOR, {"start": np.ones((4, 4), int)}, TypeError, "expected floats .* got int64"),
        (BITS, SENSOR, {"start": np.full((4, 4), np.nan)}, ValueError, "start: .* got NaN"),
        (BITS, None, {}, TypeError, "sensor: expected a jotlight.Sensor, got NoneType"),
        (PROBLEM, SENSOR, {}, TypeError, "sensor: expected none, since a Problem has its own"),
        (PROBLEM, None, {"start": np.zeros(5)}, ValueError, r"shape \(4,\), got \(5,\)"),
        (np.ones((4, 4), int), SMOOTH, {}, ValueError, "cubic kernel .* the bits are needed"),
        (np.ones((4, 4), int), VARIED, {}, ValueError, "dark counts the bits are needed"),
        (
            SENSOR.expose(scene(4, 4), rng=0),
            SMOOTH,
            {},
            ValueError,
            "kernel: expected 'box', with which the bits were made, got 'cubic'",
        ),
        (
            BITS,
            SMOOTH.replace(mask=np.ones((8, 8), bool)),
            {},
            ValueError,
            "mask: expected at least one jot that is alive, got none",
        ),
    ],
)
def test_what_does_not_fit_is_refused(data, sensor, options, error, message):
    with pytest.raises(error, match=message):
        jl.mle_iterative(data, sensor, **options)


def test_an_operator_that_does_not_fit_the_bits_is_refused():
    with pytest.raises(ValueError, match=r"operator: .* bits' shape \(4,\), got \(5,\)"):
        jl.Problem(jl.operators.spread((5,)), jl.Likelihood([0, 1, 1, 0]))


@pytest.mark.parametrize("threshold", [1, 2])
@pytest.mark.parametrize("dark", [0.0, 1e-30, 1e-7, 1e-5, 1e-3, 0.1])
def test_a_start_without_light_ends_where_any_other_does(threshold, dark):
    sensor = jl.Sensor(oversampling=4, frames=4, dark_counts=dark, threshold=threshold)
    scene = 0.05 + 0.9 * np.kron(np.random.default_rng(3).random((4, 4)), np.ones((4, 4)))
    bits = sensor.expose(scene, rng=1)
    picture = jl.mle_iterative(bits, sensor, start=np.zeros((16, 16)))
    np.testing.assert_allclose(picture, jl.mle(bits, sensor), rtol=0, atol=1e-5)


def test_the_blind_pixels_of_a_signal_are_filled():
    trials = np.full(160, 20)
    trials[40:80] = 0
    ones = np.minimum(np.random.default_rng(3).binomial(20, 0.5, 160), trials)
    light = jl.operators.spread((40,), 4, "cubic", gain=4.0)
    with pytest.warns(jl.JotlightWarning, match="6 of 40 pixels"):
        signal = jl.mle_iterative(jl.Problem(light, jl.Likelihood(ones, trials)))
    assert signal.shape == (40,)
    assert np.isfinite(signal).all()


def test_a_problem_without_a_bit_is_refused():
    light = jl.operators.scaling((4,), 1.0)
    with pytest.raises(ValueError, match="at least one cell with a bit"):
        jl.Problem(light, jl.Likelihood(np.zeros(4, int), 0))
