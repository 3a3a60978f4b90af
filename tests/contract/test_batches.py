"""The images of a stack take as many calls of the engine as one of them, with the same results."""

import warnings

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.evaluation.methods import METHODS
from jotlight.networks.inference.engine_backed import EngineBacked
from jotlight.sensing.data.pixel_counts import GrayImages
from reference.iterative import scene

SHAPE = 15, 17
SENSOR = jl.Sensor(oversampling=2, frames=4)
RANDOM = np.random.default_rng(0)
JOTS = tuple(2 * size for size in SHAPE)
MASKED = SENSOR.replace(mask=RANDOM.random(JOTS) < 0.4)
UNEQUAL = SENSOR.replace(dark_counts=RANDOM.random(JOTS) / 5, mask=RANDOM.random(JOTS) < 0.1)
SMOOTH = SENSOR.replace(kernel="quadratic")
# The linear step of ADMM needs conjugate gradients if K̂ and the degree are odd.
ASYMMETRIC = jl.Sensor(oversampling=3, frames=2, kernel="linear")
SENSORS = {
    "pixels": SENSOR,
    "dead jots": MASKED,
    "unequal jots": UNEQUAL,
    "smooth": SMOOTH,
    "asymmetric": ASYMMETRIC,
}
LEFT = np.arange(SHAPE[1]) < 8
TRIALS = np.where(LEFT, 40.0, 300.0) + np.zeros((3, *SHAPE))
TRIALS[1] += RANDOM.random(SHAPE)
TRIALS[2] = 7
"""Maps of trials with levels of the networks, above their range, and a constant one."""

ENGINE_METHODS = [name for name in METHODS if name != "held-out" and METHODS[name].available]
"""All methods. The weights of "held-out" are chosen one image after another."""

UNTIED = {
    name: jl.Network.initial(sensor.without_maps(), tied=False, taps=3)
    for name, sensor in SENSORS.items()
    if name in ("pixels", "dead jots")
}


def run_method(name, data, sensor, **options):
    """Return the estimates of a method, or of other functions of counts and bits."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        if name == "uncertainty":
            result = jl.uncertainty(data, sensor, method="mle", **options)
            return np.stack([result.low, result.high, result.standard_error], axis=-3)
        if name == "untied":
            key = "pixels" if sensor.mask is None else "dead jots"
            return UNTIED[key].reconstruct(data, sensor, **options)
        if name.endswith("gradient"):
            return jl.mle_iterative(data, sensor, solver="gradient", max_iter=9, **options)
        return METHODS[name].run(data, sensor, **options)


def cases():
    for name in [*ENGINE_METHODS, "uncertainty", "untied", "mle-iterative, gradient"]:
        for title, sensor in SENSORS.items():
            smooth = sensor.kernel != "box"
            if smooth and not name.startswith(("mle-iterative", "admm")):
                continue
            if name == "untied" and title not in UNTIED:
                continue
            if name.startswith(("network", "noniterative")) and title == "unequal jots":
                continue  # such pixels become equivalent counts, one image after another
            if name in METHODS and METHODS[name].unsupported_reason(sensor) is not None:
                continue
            yield pytest.param(name, sensor, id=f"{name}, {title}")


@pytest.fixture
def calls(monkeypatch):
    """Record the names of the functions of the engine that are called."""
    names = []

    def record(name, function):
        def recorded(*arguments):
            names.append(name)
            return function(*arguments)

        return recorded

    for name, function in vars(engine).copy().items():
        # Whether an image has few photons is asked for each one: a mean, which takes no time.
        is_work = name != "has_few_photons"
        if is_work and callable(function) and not isinstance(function, type):
            monkeypatch.setattr(engine, name, record(name, function))

    class Recorded:
        """A network of the engine, whose methods are recorded."""

        def __init__(self, network):
            self._network = network

        def __getattr__(self, name):
            found = getattr(self._network, name)
            return record(name, found) if callable(found) else found

    own = EngineBacked.engine_network.fget
    recorded = property(lambda network: Recorded(own(network)))
    monkeypatch.setattr(EngineBacked, "engine_network", recorded)
    return names


def calls_of(calls, *arguments, **options):
    calls.clear()
    estimate = run_method(*arguments, **options)
    return estimate, list(calls)


def draw(sensor):
    """Return the bits of three different scenes."""
    scenes = np.stack([scene(*SHAPE), 0.3 * scene(*SHAPE)[::-1], RANDOM.random(SHAPE)])
    return sensor.expose(scenes, rng=1)


@pytest.mark.parametrize(("name", "sensor"), [*cases()])
def test_equal_images_take_the_calls_of_a_single_one(calls, name, sensor):
    bits = draw(sensor)[0]
    alone, calls_alone = calls_of(calls, name, bits, sensor)
    estimates, calls_together = calls_of(calls, name, [bits] * 3, sensor)
    assert calls_alone
    assert calls_together == calls_alone
    np.testing.assert_array_equal(estimates, np.stack([alone] * 3))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "sensor"), [*cases()])
def test_different_images_have_their_own_results_and_share_most_calls(calls, name, sensor):
    bits = draw(sensor)
    estimates, together = calls_of(calls, name, bits, sensor)
    results = [calls_of(calls, name, each, sensor) for each in bits]
    np.testing.assert_array_equal(estimates, np.stack([alone for alone, _ in results]))
    most = max(len(alone) for _, alone in results)
    # Iterative methods run until the last image ends, and each step of an image may need more
    # evaluations than those of the others.
    assert len(together) <= (1.6 * most if name.startswith(("mle-it", "admm")) else most)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ENGINE_METHODS, "uncertainty"])
def test_maps_of_trials_take_the_calls_of_a_single_one(calls, name):
    sensor = jl.Sensor(frames=40)
    if name in METHODS and METHODS[name].unsupported_reason(sensor) is not None:
        pytest.skip("does not serve maps of trials")
    counts = RANDOM.binomial(np.floor(TRIALS).astype(int), 0.4)
    for trials, ones in zip(TRIALS, counts, strict=True):
        alone, calls_alone = calls_of(calls, name, ones, sensor, trials=trials)
        stacked = np.stack([ones] * 4), sensor
        estimates, together = calls_of(calls, name, *stacked, trials=np.stack([trials] * 4))
        assert together == calls_alone
        np.testing.assert_array_equal(estimates, np.stack([alone] * 4))
    estimates, _ = calls_of(calls, name, counts, sensor, trials=TRIALS)
    for index in range(3):
        alone, _ = calls_of(calls, name, counts[index], sensor, trials=TRIALS[index])
        np.testing.assert_array_equal(estimates[index], alone)


@pytest.mark.parametrize("name", ["mle-iterative", "admm-tv", "mle", "uncertainty"])
def test_many_pixels_are_processed_in_parts_with_the_same_results(monkeypatch, name):
    bits = draw(UNEQUAL)
    expected = run_method(name, bits, UNEQUAL)
    sizes, original = [], GrayImages.parts

    def parts(images, sensor, max_pixels=0):
        for part in original(images, sensor, 2 * SHAPE[0] * SHAPE[1]):
            sizes.append(len(part))
            yield part

    monkeypatch.setattr(GrayImages, "parts", parts)
    monkeypatch.setattr("jotlight.estimators.mle._MAX_JOTS", 8 * SHAPE[0] * SHAPE[1])
    np.testing.assert_array_equal(run_method(name, bits, UNEQUAL), expected)
    repetitions = 2 if name == "uncertainty" else 1  # it also compares the bits with S
    assert name == "mle" or sizes == repetitions * [2, 1]


@pytest.mark.parametrize("name", [name for name in ENGINE_METHODS if name != "admm-tv"])
def test_dead_pixels_of_a_stack_are_one_warning(name):
    if METHODS[name].unsupported_reason(MASKED) is not None:
        pytest.skip("does not serve dead jots")
    bits = draw(MASKED)
    with pytest.warns(jl.JotlightWarning, match="in 3 of 3 images, .* have no valid bit") as caught:
        METHODS[name].run(bits)
    assert len(caught) == 1


@pytest.mark.slow
@pytest.mark.parametrize("method", [jl.mle_iterative, jl.admm_tv])
def test_images_that_do_not_converge_are_one_warning(method):
    bits = draw(SMOOTH)
    # From its own estimate, an image converges at once.
    start = np.full((3, *SHAPE), 0.5)
    start[1] = method(bits[1], tol=1e-6, max_iter=5000)
    with pytest.warns(jl.JotlightWarning) as caught:
        _, histories = method(bits, max_iter=3, tol=1e-3, start=start, return_history=True)
    failed = [index for index in range(3) if not histories[index].converged]
    assert 1 < len(failed) < 4
    (message,) = [str(warning.message) for warning in caught]
    assert f" and {len(failed) - 1} more of 3: not converged after 3 iterations: " in message
    assert any(f", image {index} and" in message for index in failed)


@pytest.mark.parametrize("method", [jl.mle_iterative, jl.admm_tv])
def test_a_callback_ends_the_run_of_its_image(method):
    bits, seen = draw(SENSOR.replace(kernel="cubic")), []

    def stop_image_1(step):
        seen.append((step.image, step.number))
        if step.image == 1 and step.number == 3:
            raise StopIteration

    estimates, histories = method(bits, callback=stop_image_1, return_history=True)
    assert histories[1].iterations == 3 < min(histories[0].iterations, histories[2].iterations)
    for image in (0, 2):
        own = [number for each, number in seen if each == image]
        assert own == list(range(1, histories[image].iterations + 1))
        np.testing.assert_array_equal(estimates[image], method(bits[image]))
