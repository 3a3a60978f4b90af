"""The code of every instruction set returns what the scalar code returns."""

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.training.cost import Cost
from jotlight.training.parameters import parameter_vector
from jotlight.training.patches import PatchSampler
from reference import deep

SENSOR = jl.Sensor(oversampling=4)
IMAGE = jl.datasets.uniform_scene((1, 45, 83), rng=0)[0]


@pytest.fixture(params=engine.cpu_levels())
def level(request):
    yield request.param
    engine.choose_cpu_level(None)


def run_at(level, call):
    engine.choose_cpu_level(level)
    assert engine.cpu_level() == level
    return call()


def untied(frames, side):
    sensor = jl.Sensor(oversampling=side, frames=frames)
    network = jl.Network.initial(sensor)
    taps = np.random.default_rng(1).uniform(0.5, 1.5, (1, frames, side, side))
    first = network.layers[0]
    weighted = first.filters[0, 0, 0, 0] * np.float32(taps)
    layer = jl.Layer(weighted, first.coefficients, first.start, first.spacing)
    return jl.Network([layer, *network.layers[1:]], sensor)


def assert_same_as_scalar(level, call, tolerance):
    expected = run_at("scalar", call)
    for threads in (1, 2, 7):
        result = run_at(level, lambda threads=threads: call(threads))
        if threads == 1:
            first = result
        np.testing.assert_array_equal(result, first)
    if tolerance:
        scale = np.abs(expected).max()
        np.testing.assert_allclose(first, expected, rtol=0, atol=tolerance * scale)
    else:
        np.testing.assert_array_equal(first, expected)


def test_the_best_instruction_set_is_the_default(level):
    engine.choose_cpu_level(None)
    assert engine.cpu_level() == engine.cpu_levels()[-1]


def test_unknown_instruction_sets_are_refused():
    with pytest.raises(ValueError, match=r"instruction set: expected .*scalar.*, got .*mmx"):
        engine.choose_cpu_level("mmx")


@pytest.mark.parametrize("side", [1, 2, 3, 4, 8, 10])
def test_bits_and_counts_are_equal(level, side):
    frames = 40 if side == 1 else 3
    sensor = jl.Sensor(oversampling=side, frames=frames)
    assert_same_as_scalar(
        level, lambda threads=1: sensor.expose(IMAGE, 0, threads=threads).packed, 0
    )
    bits = sensor.expose(IMAGE, 0)
    assert_same_as_scalar(level, lambda threads=1: bits.counts(threads=threads), 0)


@pytest.mark.slow
@pytest.mark.parametrize("side", [1, 3, 4])
@pytest.mark.parametrize("threshold", [1, 2])
def test_bits_of_jots_with_their_own_rates_are_equal(level, side, threshold):
    maps = np.random.default_rng(0).random((45 * side, 83 * side))
    for sensor in (
        jl.Sensor(oversampling=side, frames=9, kernel="cubic", threshold=threshold),
        jl.Sensor(oversampling=side, frames=9, efficiency=maps, dark_counts=maps / 9),
    ):
        assert_same_as_scalar(
            level, lambda threads=1, s=sensor: s.expose(IMAGE, 0, threads=threads).packed, 0
        )
    if threshold > 1:
        readings = sensor.replace(threshold=1, bit_depth=3, read_noise=0.3)
        assert_same_as_scalar(
            level, lambda threads=1: readings.expose(IMAGE, 0, threads=threads).to_array(), 0
        )


@pytest.mark.parametrize("threshold", [1, 3])
def test_drawn_counts_are_equal(level, threshold):
    arguments = jl.Sensor(oversampling=9, threshold=threshold).engine_arguments()

    def draw(threads=1):
        counts = np.empty(IMAGE.shape, np.int32)
        engine.draw_counts(arguments, 2, IMAGE, bytes(32), 5, counts)
        return counts

    assert_same_as_scalar(level, draw, 0)


@pytest.mark.parametrize("width", [1, 15, 16, 17, 64, 65, 83])
def test_estimates_of_tied_networks_are_equal(level, width):
    network = jl.Network.initial(SENSOR)
    bits = SENSOR.expose(IMAGE[:, :width], 0)
    assert_same_as_scalar(level, lambda threads=1: network.reconstruct(bits, threads=threads), 1e-6)


@pytest.mark.parametrize(("frames", "side"), [(1, 3), (1, 4), (16, 1), (4, 2), (1, 8), (1, 12)])
def test_estimates_of_untied_networks_are_equal(level, frames, side):
    network = untied(frames, side)
    bits = network.sensor.expose(IMAGE, 0)
    assert_same_as_scalar(level, lambda threads=1: network.reconstruct(bits, threads=threads), 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("size", ["small", "medium"])
@pytest.mark.parametrize("width", [1, 16, 83])
def test_estimates_of_deep_networks_are_equal(level, size, width):
    rng = np.random.default_rng(3)
    bits = SENSOR.expose(IMAGE[:, :width], 0)
    for network in (
        jl.Network.residual(SENSOR, size, rng=0),
        jl.Network.conditional(size, rng=0),
    ):
        alive = deep.with_noise(network, rng)
        assert_same_as_scalar(
            level,
            lambda threads=1, alive=alive: alive.reconstruct(bits, SENSOR, threads=threads),
            1e-5,
        )


def test_estimates_of_networks_of_any_graph_are_equal(level):
    network = deep.random_graph(
        np.random.default_rng(0), jl.Sensor(oversampling=4, frames=2), tied=False
    )
    bits = network.sensor.expose(IMAGE, 0)
    assert_same_as_scalar(level, lambda threads=1: network.reconstruct(bits, threads=threads), 1e-5)


def test_gradients_of_the_training_cost_are_equal(level):
    network = jl.Network.initial(SENSOR)
    scenes = jl.datasets.uniform_scene((4, 33, 47), rng=1)

    def gradient(threads=1):
        examples = PatchSampler(scenes, SENSOR, 0, 8, 32, network.halo)
        cost = Cost(network, examples, 0, 1, jl.training.SafeSet(), threads)
        return cost.gradient(parameter_vector(network))[1]

    assert_same_as_scalar(level, gradient, 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("method", [jl.admm_tv, jl.mle_iterative, jl.mle])
def test_estimates_of_the_likelihood_methods_are_equal(level, method):
    bits = SENSOR.expose(IMAGE, 0)
    assert_same_as_scalar(level, lambda threads=1: method(bits, SENSOR, threads=threads), 1e-5)


@pytest.mark.parametrize("coefficients", [4, 13, 19, 20])
def test_values_and_gradients_of_splines_are_equal(level, coefficients):
    rng = np.random.default_rng(0)
    # Some values are outside the domain, and the number of values is not a multiple of a register.
    planes = rng.uniform(-4, 4, (3, 5, 4103)).astype(np.float32)
    gradient = rng.normal(size=planes.shape).astype(np.float32)
    weights = rng.normal(size=(5, coefficients)).astype(np.float32)
    knots = -3.0, 6 / (coefficients - 3)

    def pull_back(part):
        return lambda threads=1: engine.activate_backward(
            (planes, weights), gradient, *knots, threads
        )[part]

    assert_same_as_scalar(
        level, lambda threads=1: engine.activate((planes, weights), *knots, threads), 1e-6
    )
    assert_same_as_scalar(level, pull_back(0), 1e-6)
    # Sums over thousands of pixels are rounded.
    assert_same_as_scalar(level, pull_back(1), 1e-5)
