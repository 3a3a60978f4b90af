"""The contract that every method in `METHODS` must keep, including new ones."""

import functools
import inspect

import numpy as np
import pytest
from scipy.special import gammainc
from scipy.stats import poisson

import jotlight as jl
from jotlight.evaluation.methods import METHODS, option_advice

SENSOR = jl.Sensor(oversampling=2, frames=4)
SIZE = 12
BITS = SENSOR.expose(np.linspace(0, 1, SIZE * SIZE).reshape(SIZE, SIZE), rng=0)


@pytest.fixture(params=METHODS)
def name(request):
    if not METHODS[request.param].available:
        pytest.skip(f"{request.param} needs the package {METHODS[request.param].required_package}")
    return request.param


@pytest.fixture
def run(name):
    return METHODS[name].run


def skip_unless_supported(name, sensor):
    if (reason := METHODS[name].unsupported_reason(sensor)) is not None:
        pytest.skip(f"{name} does not serve this sensor: {reason}")


def first_supported(name, *sensors):
    return next(sensor for sensor in sensors if METHODS[name].unsupported_reason(sensor) is None)


def test_every_method_serves_the_sensor_of_these_tests(name):
    assert METHODS[name].unsupported_reason(SENSOR) is None


@functools.cache
def estimate_of_bits(name):
    return METHODS[name].run(BITS, SENSOR)


def assert_same(name, first, second):
    """Assert equality of all bits, except for BM3D, whose threads add in a random order."""
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-3 if "bm3d" in name else 0)


def test_the_estimate_is_a_finite_float32_image_and_the_bits_stay_unchanged(name):
    before = BITS.packed.copy()
    estimate = estimate_of_bits(name)
    assert (type(estimate), estimate.dtype, estimate.shape) == (
        np.ndarray,
        np.float32,
        (SIZE, SIZE),
    )
    assert np.isfinite(estimate).all()
    assert estimate.std() > 0.1
    np.testing.assert_array_equal(BITS.packed, before)


@pytest.mark.parametrize("pattern", ["none", "all", "checkerboard", "halves", "noise"])
def test_the_estimate_stays_in_its_range_for_any_bits(name, run, pattern):
    sensor = first_supported(name, jl.Sensor(frames=6, max_intensity=0.7), jl.Sensor(frames=16))
    trials, max_intensity = sensor.trials, sensor.max_intensity
    rows, columns = np.mgrid[:SIZE, :SIZE]
    fraction = {
        "none": 0,
        "all": 1,
        "checkerboard": (rows + columns) % 2,
        "halves": columns < SIZE // 2,
        "noise": np.random.default_rng(1).random((SIZE, SIZE)),
    }[pattern]
    counts = np.rint(trials * fraction * np.ones((SIZE, SIZE))).astype(int)
    estimate = run(counts, sensor)
    assert np.isfinite(estimate).all()
    assert estimate.min() >= 0
    assert estimate.max() <= np.float32(max_intensity)
    if pattern == "none":
        # A trained network knows that photographs are rarely fully black.
        assert estimate.max() < (0.03 if name == "network-two-layer" else 0.01)
    if pattern == "all":
        assert estimate.min() > max_intensity - 0.01


def fisher_deviation(sensor, intensity):
    """Return the Cramér-Rao bound of an unbiased estimate from K bits: 1/√(K I(c))."""
    sensitivity = sensor.efficiency * sensor.gain / sensor.trials
    rate = sensitivity * intensity + sensor.dark_counts
    probability = gammainc(sensor.threshold, rate)
    slope = sensitivity * poisson.pmf(sensor.threshold - 1, rate)
    return np.sqrt(probability * (1 - probability) / sensor.trials) / slope


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=16_384),
        jl.Sensor(frames=16_384, threshold=2, dark_counts=0.2, efficiency=0.7, max_intensity=3.0),
    ],
    ids=repr,
)
def test_the_error_from_many_bits_reaches_the_cramer_rao_bound(name, run, sensor):
    skip_unless_supported(name, sensor)
    probability = gammainc(sensor.threshold, sensor.efficiency * 0.5 + sensor.dark_counts)
    counts = np.random.default_rng(2).binomial(sensor.frames, probability, (20, 20))
    error = run(counts, sensor) - 0.5
    deviation = fisher_deviation(sensor, 0.5)
    # The mean square of 400 errors has a relative deviation of √(2/400). The limit is five of them.
    assert np.sqrt(np.mean(error**2)) < deviation * np.sqrt(1 + 5 * np.sqrt(2 / 400))
    assert deviation < 0.02


def test_more_light_makes_a_brighter_estimate(run):
    scenes = [np.full((SIZE, SIZE), light) for light in (0.1, 0.4, 0.8)]
    means = [run(SENSOR.expose(scene, rng=3), SENSOR).mean() for scene in scenes]
    # The mean over 144 pixels of 16 bits has an error of 0.03, and clipping to [0, 1] adds a bias.
    np.testing.assert_allclose(means, [0.1, 0.4, 0.8], atol=0.08)


def test_bits_and_their_counts_have_the_same_estimate(name, run):
    assert_same(name, run(BITS.counts(SENSOR.oversampling), SENSOR), estimate_of_bits(name))


def test_one_thread_and_all_threads_have_the_same_estimate(name, run):
    assert_same(name, run(BITS, SENSOR, threads=1), estimate_of_bits(name))


def test_channels_do_not_mix(name, run):
    scene = np.random.default_rng(4).random((SIZE, SIZE, 2))
    scene[..., 0] = np.linspace(0, 1, SIZE)
    bits = SENSOR.expose(scene, rng=5, channel_axis=-1)
    bits.packed[..., 0] = BITS.packed
    estimate = run(bits, SENSOR)
    assert estimate.shape == (SIZE, SIZE, 2)
    assert_same(name, estimate[..., 0], estimate_of_bits(name))
    assert (np.abs(estimate[..., 1] - estimate[..., 0]) > 0.1).any()


def test_the_images_of_a_stack_are_estimated_one_by_one(name, run):
    scenes = np.random.default_rng(7).random((2, SIZE, SIZE))
    stack = [BITS, *SENSOR.expose(scenes, rng=8)]
    estimates = run(stack)
    assert estimates.shape == (3, SIZE, SIZE)
    assert_same(name, estimates[0], estimate_of_bits(name))
    for bits, estimate in zip(stack, estimates, strict=True):
        assert_same(name, estimate, run(bits, SENSOR))


def test_counts_have_a_stack_and_channels(name, run):
    # Of three channels, "held-out" estimates all together.
    counts = np.random.default_rng(9).integers(0, SENSOR.trials + 1, (2, SIZE, SIZE, 4))
    estimates = run(counts, SENSOR, channel_axis=-1)
    assert estimates.shape == counts.shape
    assert_same(name, estimates[1, ..., 2], run(counts[1, ..., 2], SENSOR))
    assert_same(name, run(np.moveaxis(counts, -1, 1), SENSOR), np.moveaxis(estimates, -1, 1))
    with pytest.raises(ValueError, match="looks like color; pass channel_axis=-1"):
        run(counts[0], SENSOR)


def test_dead_jots_change_the_estimate_by_no_more_than_their_missing_bits(name, run):
    sensor = first_supported(name, jl.Sensor(oversampling=4, frames=16), jl.Sensor(oversampling=4))
    mask = np.tile(np.eye(4, dtype=bool), (SIZE, SIZE))
    mask[:, : 2 * SIZE] = False
    scene = np.full((SIZE, SIZE), 0.5)
    unmasked = run(sensor.expose(scene, rng=6), sensor)
    masked_sensor = sensor.replace(mask=mask)
    masked = run(masked_sensor.expose(scene, rng=6), masked_sensor)
    # The estimates from 12 and from 16 jots differ by √(16/12 - 1) = 0.58 standard deviations.
    deviation = fisher_deviation(sensor, 0.5)
    difference = masked[:, SIZE // 2 :] - unmasked[:, SIZE // 2 :]
    assert np.sqrt(np.mean(difference**2)) < 0.58 * deviation * (1 + 5 / np.sqrt(2 * 72))


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (8, 8)])
def test_the_smallest_images_work(run, shape):
    counts = np.random.default_rng(7).integers(0, SENSOR.trials + 1, shape)
    estimate = run(counts, SENSOR)
    assert estimate.shape == shape
    assert np.isfinite(estimate).all()


@pytest.mark.parametrize(
    ("data", "sensor", "error", "message"),
    [
        (BITS, SENSOR.replace(frames=9), ValueError, "expected the sensor's 9 frames, got 4"),
        (BITS, SENSOR.replace(oversampling=5), ValueError, "multiples of the oversampling 5"),
        (BITS, SENSOR.replace(mask=np.zeros((4, 4), bool)), ValueError, "mask: expected one"),
        (
            jl.Bits(BITS.packed),
            SENSOR.replace(dark_counts=np.full((4, 4), 0.01)),
            ValueError,
            "dark_counts: expected one",
        ),
        (np.full((SIZE, SIZE), 17), SENSOR, ValueError, "0 to K = 16 .* got 17 to 17"),
        (np.full((SIZE, SIZE), -1), SENSOR, ValueError, "got -1"),
        (np.ones((SIZE, SIZE)), SENSOR, TypeError, "image of counts in whole numbers, got float64"),
        (np.ones((SIZE, SIZE), bool), SENSOR, TypeError, "got bool"),
        (np.ones(SIZE, int), SENSOR, ValueError, r"expected shape \(H, W\)"),
        (np.ones((0, SIZE), int), SENSOR, ValueError, r"expected shape \(H, W\)"),
    ],
)
def test_data_that_do_not_fit_the_sensor_are_refused(name, run, data, sensor, error, message):
    skip_unless_supported(name, sensor)
    with pytest.raises(error, match=message):
        run(data, sensor)


def test_a_sensor_without_a_live_jot_is_refused(run):
    with pytest.raises(ValueError, match="at least one pixel with a valid bit"):
        run(BITS, SENSOR.replace(mask=np.ones((24, 24), bool)))


@pytest.mark.parametrize("changes", [{"read_noise": 0.3}, {"bit_depth": 3}, {"gain": [1, 2]}])
@pytest.mark.parametrize(
    "method", ["mle", "mle-iterative", "admm-tv", "noniterative-tv", "network-small", None]
)
def test_a_sensor_of_other_readings_without_a_live_jot_is_refused(method, changes):
    sensor = jl.Sensor(frames=2, mask=np.ones((8, 8), bool), **changes)
    data = sensor.expose(np.full((8, 8), 0.5), rng=0)
    for function in (jl.reconstruct, jl.uncertainty):
        with pytest.raises(ValueError, match="at least one pixel with a valid bit"):
            function(data, method=method)


@pytest.mark.parametrize(
    "changes",
    [{"efficiency": [[0.5]]}, {"dark_counts": [[0.1]]}, {"mask": np.zeros((1, 1), bool)}],
    ids=str,
)
@pytest.mark.parametrize(
    "method", ["mle", "mle-iterative", "admm-tv", "noniterative-tv", "network-small", None]
)
def test_images_of_one_pixel_with_a_map_are_estimated_as_alone(method, changes):
    sensor = jl.Sensor(frames=4, max_intensity=9.0, **changes)
    stack = np.array([[[2]], [[3]]])
    alone = np.stack([jl.reconstruct(one, sensor, method=method) for one in stack])
    np.testing.assert_array_equal(jl.reconstruct(stack, sensor, method=method), alone)
    color = jl.reconstruct(stack.reshape(1, 1, 2), sensor, method=method, channel_axis=-1)
    assert color.shape == (1, 1, 2)
    bits = [jl.Bits.from_array(np.arange(4)[:, None, None] < one, sensor) for one in stack]
    np.testing.assert_array_equal(jl.reconstruct(bits, method=method), alone)


def test_every_misspelled_argument_of_reconstruct_gets_its_name():
    names = list(inspect.signature(jl.reconstruct).parameters)
    assert names[-1] == "options"
    for name in names[:-1]:
        assert option_advice(f"{name}s") == f"did you mean {name}?"
        assert option_advice(name) == "leave it out"
