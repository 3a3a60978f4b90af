"""All functions that return images write them into the array `out`, and return it."""

import functools
import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from jotlight.layout import Layout
from jotlight.sensing.bits.output_images import OutputImages, check_out

SENSOR = jl.Sensor(oversampling=2, frames=8)
SHAPE = 15, 17
RANDOM = np.random.default_rng(0)
SCENES = RANDOM.random((3, *SHAPE))
BITS = SENSOR.expose(SCENES, rng=1)
COUNTS = np.stack([bits.counts() for bits in BITS])
COLOR = SENSOR.expose(np.moveaxis(SCENES, 0, -1), rng=1, channel_axis=-1)
DEAD = RANDOM.random([2 * size for size in SHAPE]) < 0.5
MASKED = SENSOR.replace(mask=DEAD)
FEW = jl.Sensor(frames=3, gain=[1.0, 2.0, 4.0])
METHOD_NAMES = [name for name in METHODS if METHODS[name].available]


def estimators():
    """Return the functions that estimate images, by name."""
    functions = {name: METHODS[name].run for name in METHOD_NAMES}
    for name in METHOD_NAMES:
        functions[f"reconstruct, {name}"] = functools.partial(jl.reconstruct, method=name)
    functions["reconstruct"] = jl.reconstruct
    functions["reconstruct, photons"] = functools.partial(jl.reconstruct, units="photons")
    functions["reconstruct, fallback"] = functools.partial(
        jl.reconstruct, method="network-small", fallback=True
    )
    functions["reconstruct, own"] = functools.partial(jl.reconstruct, method=own_method)
    functions["conditional network"] = jl.pretrained(SENSOR, "medium")
    functions["mle"] = jl.mle
    functions["noniterative"] = jl.noniterative
    functions["mle_iterative"] = jl.mle_iterative
    functions["admm_tv"] = jl.admm_tv
    return functions


def own_method(data, sensor):
    counts = data if isinstance(data, np.ndarray) else data.counts()
    return counts / sensor.trials


DATA = {
    "bits": (BITS[0], SENSOR),
    "list": (BITS, SENSOR),
    "color": (COLOR, SENSOR),
    "counts": (COUNTS[0], SENSOR),
    "stack": (COUNTS, SENSOR),
    "dead jots": (BITS[1], MASKED),
}


def check(function, *arguments, **options):
    """Assert that `out` of any strides gets the result that a call without it returns."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        expected = function(*arguments, **options)
        spaced = np.full([2 * size for size in expected.shape], 7, expected.dtype)
        turned = np.full(expected.shape[::-1], 7, expected.dtype)
        for out in (
            np.full(expected.shape, 7, expected.dtype),
            spaced[tuple(slice(None, None, 2) for _ in expected.shape)],
            turned.T,
        ):
            assert function(*arguments, out=out, **options) is out
            np.testing.assert_array_equal(out, expected)
        assert (spaced[tuple(slice(1, None, 2) for _ in expected.shape)] == 7).all()
        refuse(function, expected, arguments, options)


def refuse(function, expected, arguments, options):
    name = expected.dtype.name
    read_only = np.empty_like(expected)
    read_only.flags.writeable = False
    for out, received in (
        (np.empty(expected.shape, np.float64), "float64"),
        (np.empty(expected.shape, expected.dtype.newbyteorder()), "[<>]"),
        (np.empty((*expected.shape, 1), expected.dtype), r"1\)"),
        (np.empty((expected.shape[0] + 1, *expected.shape[1:]), expected.dtype), name),
        (read_only, "read-only"),
    ):
        message = f"out: expected a writeable array of {name} .*{received}"
        with pytest.raises(ValueError, match=message):
            function(*arguments, out=out, **options)
    with pytest.raises(TypeError, match=r"out: expected a writeable array .* got list"):
        function(*arguments, out=[[0.0]], **options)


def cases():
    """Yield all functions with all data. Fast are bits, and counts of functions by their name."""
    for name in estimators():
        for data in DATA:
            is_fast = data == "bits" or (data == "counts" and name not in METHODS)
            is_fast &= "held" not in name and "large" not in name
            marks = [pytest.mark.slow] * (not is_fast or "reconstruct, n" in name)
            # `reconstruct` gives all kinds of data to each method in the same way.
            is_alike = name.startswith("reconstruct, ") and data in ("list", "counts", "dead jots")
            yield pytest.param(name, data, marks=[*marks, *[pytest.mark.exhaustive] * is_alike])


@pytest.mark.parametrize(("name", "data"), [*cases()])
def test_estimates_are_written_to_out(name, data):
    check(estimators()[name], *DATA[data])


def test_channels_may_be_any_axis():
    for axis in (0, 1, 2, -1, -2, -3):
        counts = np.moveaxis(COUNTS, 0, axis)
        check(jl.mle, counts, SENSOR, channel_axis=axis)
        check(jl.reconstruct, counts, SENSOR, channel_axis=axis, method="network-two-layer")


def test_networks_for_weighted_jots():
    network = jl.Network.initial(SENSOR, tied=False, taps=3)
    for data, sensor in (DATA["bits"], DATA["list"], DATA["dead jots"]):
        check(network, data, sensor)


@pytest.mark.slow
def test_maps_of_trials():
    trials = np.where(np.arange(SHAPE[1]) < 8, 32.0, 700.0) + np.zeros(SHAPE)
    for name in ("network-small", "mle", "admm-tv"):
        check(METHODS[name].run, COUNTS[0], SENSOR, trials=trials)


@pytest.mark.slow
def test_readings_that_differ():
    bits = FEW.expose(SCENES[0], rng=0)
    for method in (jl.mle, jl.reconstruct):
        check(method, bits)
    several = jl.Sensor(frames=4, bit_depth=3).expose(SCENES[0], rng=0)
    for method in (jl.mle, jl.noniterative, jl.reconstruct):
        check(method, several)


def test_iterative_methods_of_a_problem():
    problems = [
        jl.Problem(jl.operators.scaling(ones.shape, 1.0), jl.Likelihood(ones, 32), 9.0)
        for ones in (COUNTS[0], COUNTS[0, 0])
    ]
    for method in (jl.mle_iterative, jl.admm_tv):
        for problem in problems:
            check(method, problem)
        estimate, history = method(COUNTS[0], SENSOR, return_history=True, out=(out := blank()))
        assert estimate is out
        assert history.converged


def blank():
    return np.empty(SHAPE, np.float32)


def test_information_comes_with_out():
    out = blank()
    estimate, info = jl.reconstruct(BITS[0], out=out, method="mle", return_info=True)
    assert estimate is out
    assert info.method == "mle"


@pytest.mark.parametrize("kernel", ["box", "cubic"])
def test_rates_and_probabilities(kernel):
    for sensor in (
        SENSOR.replace(kernel=kernel),
        jl.Sensor(frames=3, gain=[1.0, 2.0, 1.0], threshold=[1, 1, 2], kernel=kernel),
        jl.Sensor(read_noise=0.2, kernel=kernel),
    ):
        for function in (sensor.rate, sensor.probability):
            check(function, SCENES[0])
            check(function, SCENES)
            check(function, SCENES, channel_axis=0)


def test_rates_may_overwrite_their_image():
    sensor = jl.Sensor(kernel="cubic")
    image = SCENES[0].astype(np.float32)
    expected = sensor.rate(image)
    assert sensor.rate(image, out=image) is image
    np.testing.assert_array_equal(image, expected)
    differing = jl.Sensor(threshold=np.arange(2 * 15 * 17).reshape(30, 17)[:15] % 2 + 1)
    image = SCENES[0].astype(np.float32)
    expected = differing.probability(image)
    np.testing.assert_array_equal(differing.probability(image, out=image), expected)


def test_counts_of_bits():
    check(BITS[0].counts)
    check(COLOR.counts)
    check(BITS[0].counts, 1, mask=DEAD)
    # NumPy can make arrays whose elements are not aligned.
    unaligned = np.zeros(4 * COUNTS[0].size + 1, np.uint8)[1:].view(np.int32).reshape(SHAPE)
    assert not unaligned.flags.aligned
    assert BITS[0].counts(out=unaligned) is unaligned
    np.testing.assert_array_equal(unaligned, COUNTS[0])
    unaligned = unaligned.view(np.float32)
    np.testing.assert_array_equal(jl.mle(BITS[0], out=unaligned), jl.mle(BITS[0]))


def test_masked_arrays_are_refused():
    with pytest.raises(TypeError, match="out"):
        jl.mle(COUNTS[0], SENSOR, out=np.ma.zeros(SHAPE, np.float32))


def test_the_memory_of_out_is_used():
    out = np.zeros((2, 4, 5), np.float32)
    assert np.shares_memory(OutputImages(Layout((2,)), (4, 5), out).images, out)
    assert not np.shares_memory(OutputImages(Layout((2,)), (4, 5), out, inputs=[out]).images, out)
    assert check_out(out, (2, 4, 5), np.float32) is out
