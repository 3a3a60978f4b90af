"""The engine's cost, gradient, and normal equations against slow twins."""

import time

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.seeds import seed_bytes
from jotlight.training.parameters import engine_layers, parameter_vector
from reference import training as twins
from reference.networks import random_network
from ticking import ticking

SEED = np.random.SeedSequence(5)
CASES = {
    "one layer": ([1], []),
    "two layers": ([1, 1], [(3, 3)]),
    "even filters": ([3, 1], [(2, 4)]),
    "three layers": ([2, 3, 1], [(1, 3), (3, 2)]),
    "four layers": ([3, 2, 2, 1], [(3, 3), (2, 2), (3, 1)]),
}
SENSORS = {
    "box": jl.Sensor(oversampling=2, frames=2),
    "box, q = 2": jl.Sensor(oversampling=3, threshold=2, gain=20.0),
    "cubic": jl.Sensor(oversampling=2, frames=3, kernel="cubic", dark_counts=0.1),
    "cubic, q = 2": jl.Sensor(oversampling=3, kernel="cubic", threshold=2, efficiency=0.8),
}
# Patches of different sizes: inside the images, at their rims, and a whole image.
PATCHES = [(0, 2, 8, 3, 10), (1, 0, 7, 0, 8), (0, 4, 12, 0, 9), (1, 0, 7, 2, 6)]
IMAGES = [
    np.random.default_rng(index).random(shape, np.float32)
    for index, shape in enumerate([(12, 13), (7, 8)])
]


def batch_of(sensor, *, images=IMAGES, patches=PATCHES, border=1, **changes):
    described = {
        "sensor": sensor.engine_arguments(),
        "frames": sensor.frames,
        "images": images,
        "patches": np.array(patches, np.int64).reshape(-1, 5),
        "border": border,
        "seed": seed_bytes(SEED),
    }
    return {**described, **changes}


def crops(patches=PATCHES, images=IMAGES):
    return [images[i][top:bottom, left:right] for i, top, bottom, left, right in patches]


def patch_bits(sensor, patches=PATCHES, *, tied):
    """Bits of each patch: patch i uses the frames from i·T on.

    With a box kernel, a tied network receives counts. Bits with the same counts represent them.
    """
    side, frames = sensor.oversampling, sensor.frames
    all_frames = sensor.replace(frames=len(patches) * frames)
    for index, crop in enumerate(crops(patches)):
        if tied and sensor.kernel == "box":
            counts = np.empty(crop.shape, np.int32)
            arguments = (sensor.engine_arguments(), frames, crop, seed_bytes(SEED), index, counts)
            engine.draw_counts(*arguments)
            ones = np.arange(sensor.trials).reshape(frames, 1, side, 1, side)
            bits = ones < counts[None, :, None, :, None]
            yield bits.reshape(frames, len(crop) * side, -1)
        else:
            mine = slice(index * frames, (index + 1) * frames)
            yield all_frames.expose(crop, SEED, frames=mine).to_array()


def counted_pixels(patches=PATCHES, border=1):
    return [twins.counted_pixels(patch, IMAGES[patch[0]].shape, border) for patch in patches]


def network_away_from_knots(case, sensor, *, tied):
    """A network whose sums avoid the ends of the splines, where the slope jumps to 0."""
    for seed in range(100):
        network = random_network(np.random.default_rng(seed), sensor, *CASES[case], tied=tied)
        vector = parameter_vector(network)
        gaps = [
            np.abs(plane - end).min()
            for bits in patch_bits(sensor, tied=tied)
            for layer, plane in zip(
                network.layers, twins.spline_inputs(network, vector, bits), strict=True
            )
            for end in (layer.start, layer.start + layer.spacing * 8)
        ]
        if min(gaps) > 3e-4:
            return network, vector
    raise AssertionError("no such network")


def in_float64(network, vector):
    return engine_layers(network, vector, np.float64)


def kinds_of_gradients():
    """Yield all products. The fast ones have all pairs of a case and a sensor."""
    for i, case in enumerate(CASES):
        for j, (name, sensor) in enumerate(SENSORS.items()):
            for tied in (True, False):
                marks = [] if (i + j) % 2 == tied else [pytest.mark.slow]
                yield pytest.param(case, sensor, tied, id=f"{case}-{name}-{tied}", marks=marks)


@pytest.mark.parametrize(("case", "sensor", "tied"), list(kinds_of_gradients()))
def test_gradients_equal_central_differences(case, sensor, tied):
    """Equations (14) and (16) to (19)."""
    network, vector = network_away_from_knots(case, sensor, tied=tied)
    batch = batch_of(sensor)

    def cost(vector):
        errors, _ = engine.squared_errors(in_float64(network, vector), batch, None)
        return np.array([0.5 * errors.mean()])

    (errors, pixels), gradient = engine.gradient(in_float64(network, vector), batch, None)
    expected = twins.jacobian(cost, vector)[0]
    np.testing.assert_allclose(gradient, expected, rtol=1e-6, atol=1e-8 * np.abs(expected).max())
    again, same = engine.squared_errors(in_float64(network, vector), batch, None)
    np.testing.assert_array_equal(errors, again)
    np.testing.assert_array_equal(pixels, same)
    (_, _), single = engine.gradient(engine_layers(network, vector), batch, None)
    # The error of a single derivative in float32 varies; that of the whole gradient is bounded.
    assert np.linalg.norm(single - gradient) < 2e-5 * np.linalg.norm(gradient)


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
@pytest.mark.parametrize("border", [0, 1, 2])
def test_errors_equal_the_twins_over_the_counted_pixels(sensor, border, tied):
    network = random_network(np.random.default_rng(3), sensor, *CASES["three layers"], tied=tied)
    vector = parameter_vector(network)
    errors, pixels = engine.squared_errors(
        in_float64(network, vector), batch_of(sensor, border=border), None
    )
    drawn = patch_bits(sensor, tied=tied)
    parts = zip(drawn, crops(), counted_pixels(border=border), strict=True)
    expected = [
        np.sum((twins.output(network, vector, bits) - crop)[inside] ** 2)
        for bits, crop, inside in parts
    ]
    np.testing.assert_allclose(errors, expected, rtol=1e-11)
    assert list(pixels) == [inside.sum() for inside in counted_pixels(border=border)]
    assert pixels[1] == 7 * 8  # the image ends where the patch does


@pytest.mark.slow
@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("sensor", [SENSORS["box"], SENSORS["cubic, q = 2"]], ids=repr)
@pytest.mark.parametrize("case", ["one layer", "even filters", "three layers"])
def test_the_matrix_is_the_mean_of_squared_jacobians(case, sensor, tied):
    network, vector = network_away_from_knots(case, sensor, tied=tied)
    batch = batch_of(sensor)
    expected, slope = 0, 0
    drawn = patch_bits(sensor, tied=tied)
    for bits, crop, inside in zip(drawn, crops(), counted_pixels(), strict=True):

        def estimate(vector, bits=bits, inside=inside):
            return twins.output(network, vector, bits)[inside]

        jacobian = twins.jacobian(estimate, vector)
        expected = expected + jacobian.T @ jacobian / len(PATCHES)
        slope = slope + jacobian.T @ (estimate(vector) - crop[inside]) / len(PATCHES)
    both = engine.normal_equations(in_float64(network, vector), batch, None)
    (errors, pixels), gradient, matrix = both
    np.testing.assert_allclose(matrix, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_allclose(gradient, slope, rtol=1e-6, atol=1e-7 * np.abs(slope).max())
    np.testing.assert_array_equal(matrix, matrix.T)
    single = engine.normal_equations(engine_layers(network, vector), batch, None)[2]
    assert np.linalg.norm(single - matrix) < 2e-5 * np.linalg.norm(matrix)
    alone = engine.gradient(in_float64(network, vector), batch, None)
    np.testing.assert_array_equal(gradient, alone[1])
    np.testing.assert_array_equal(errors, alone[0][0])
    np.testing.assert_array_equal(pixels, alone[0][1])


def test_the_rim_of_a_whole_image_counts():
    sensor = SENSORS["box"]
    network = random_network(np.random.default_rng(4), sensor, *CASES["two layers"], tied=True)
    whole = [(0, 0, 12, 0, 13)]
    batch = batch_of(sensor, patches=whole, border=5)
    vector = parameter_vector(network)
    (error,), (pixels,) = engine.squared_errors(engine_layers(network, vector), batch, None)
    (bits,) = patch_bits(sensor, whole, tied=True)
    estimate = twins.output(network, vector, bits)
    assert pixels == 12 * 13
    assert error == pytest.approx(np.sum((estimate - IMAGES[0]) ** 2), rel=1e-5)


def test_a_patch_inside_its_border_counts_for_nothing():
    sensor = SENSORS["box"]
    network = random_network(np.random.default_rng(4), sensor, *CASES["two layers"], tied=True)
    layers = engine_layers(network, parameter_vector(network))
    batch = batch_of(sensor, patches=[(0, 2, 6, 3, 7)], border=2)
    (errors, pixels), gradient, matrix = engine.normal_equations(layers, batch, None)
    assert (errors[0], pixels[0]) == (0, 0)
    assert not gradient.any()
    assert not matrix.any()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("tied", [True, False])
def test_the_number_of_threads_changes_nothing(dtype, tied):
    sensor = SENSORS["box"]
    network = random_network(np.random.default_rng(6), sensor, *CASES["three layers"], tied=tied)
    layers = engine_layers(network, parameter_vector(network), dtype)
    scenes = np.random.default_rng(7).random((37, 9, 11), np.float32)
    patches = [(i, 0, 9, 0, 11) if i % 2 else (i, 1, 8, 2, 9) for i in range(37)]
    results = []
    for threads in (1, 2, 3, None):
        batch = batch_of(sensor, images=scenes, patches=patches)
        (errors, _), gradient, matrix = engine.normal_equations(layers, batch, threads)
        alone = engine.gradient(layers, batch, threads)[1]
        value = engine.squared_errors(layers, batch, threads)[0]
        results.append(np.concatenate([errors, gradient, matrix.ravel(), alone, value]))
    for other in results[1:]:
        np.testing.assert_array_equal(results[0], other)


def test_a_stack_and_a_list_of_images_are_equal():
    sensor = SENSORS["cubic"]
    network = random_network(np.random.default_rng(6), sensor, *CASES["two layers"], tied=False)
    layers = engine_layers(network, parameter_vector(network))
    scenes = np.random.default_rng(7).random((3, 9, 11), np.float32)
    patches = [(2, 0, 9, 0, 11), (0, 1, 8, 2, 9), (1, 0, 5, 6, 11)]
    stack, each = (
        engine.gradient(layers, batch_of(sensor, images=images, patches=patches), None)
        for images in (scenes, list(scenes))
    )
    np.testing.assert_array_equal(stack[0], each[0])
    np.testing.assert_array_equal(stack[1], each[1])


PLAIN = SENSORS["box"]
ONE = random_network(np.random.default_rng(8), PLAIN, *CASES["two layers"], tied=False)
CALLS = [engine.squared_errors, engine.gradient, engine.normal_equations]


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.__name__)
@pytest.mark.parametrize(
    "patches",
    [
        np.empty((0, 5)),
        [(0, 0, 13, 0, 8)],
        [(0, 0, 8, 6, 14)],
        [(1, 0, 8, 0, 8)],
        [(0, -1, 7, 0, 8)],
        [(0, 0, 8, -4, 8)],
        [(2, 0, 5, 0, 5)],
        [(-1, 0, 5, 0, 5)],
        [(0, 5, 5, 0, 5)],
        [(0, 5, 3, 0, 5)],
        [(0, 0, 5, 0, 5), (0, 0, 5, 4, 4)],
        [(0, 0, 5, 0)],
        [(0, 0, 5, 0, 5, 9)],
    ],
    ids=lambda patches: str(list(patches)),
)
def test_patches_outside_their_image_are_refused(call, patches):
    batch = {**batch_of(PLAIN), "patches": np.array(patches, np.int64)}
    with pytest.raises(ValueError, match="expected"):
        call(engine_layers(ONE, parameter_vector(ONE)), batch, None)


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.__name__)
@pytest.mark.parametrize(
    "changes",
    [
        {"images": []},
        {"frames": 3},
        {"frames": 0},
        {"sensor": PLAIN.replace(oversampling=3).engine_arguments()},
        {"sensor": PLAIN.replace(mask=np.zeros((24, 26), bool)).engine_arguments()},
        {"sensor": PLAIN.replace(dark_counts=np.zeros((24, 26))).engine_arguments()},
    ],
    ids=["no images", "frames", "no frames", "block", "mask", "dark counts"],
)
def test_a_batch_that_does_not_fit_is_refused(call, changes):
    with pytest.raises(ValueError, match="expected"):
        call(engine_layers(ONE, parameter_vector(ONE)), {**batch_of(PLAIN), **changes}, None)


@pytest.fixture
def ticks():
    """A number that another thread increments whenever it can run."""
    with ticking(lambda: time.sleep(1e-4)) as count:
        yield count


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.__name__)
def test_other_threads_run_during_a_call(call, ticks):
    layers = engine_layers(ONE, parameter_vector(ONE))
    scenes = np.full((512, 32, 32), 0.5, np.float32)
    batch = batch_of(PLAIN, images=scenes, patches=[(i, 0, 32, 0, 32) for i in range(512)])
    seen = 0
    for _ in range(100):
        before = ticks[0]
        call(layers, batch, 1)
        seen = max(seen, ticks[0] - before)
        if seen > 10:
            return
    pytest.fail(f"at most {seen} ticks in a call")
