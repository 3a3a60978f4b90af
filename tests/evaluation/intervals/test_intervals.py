"""The uncertainty of any method: coverage, stacks, maps of jots, and bad input."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import binom

import jotlight as jl

CAMERA = jl.datasets.photograph("camera")[100:196, 180:276]
SENSOR = jl.Sensor(frames=16)
COUNTS = SENSOR.expose(CAMERA, rng=0).counts()


def covered(known, image):
    return float(((known.low <= image) & (image <= known.high)).mean())


@pytest.mark.parametrize("trials", [1, pytest.param(3, marks=pytest.mark.slow), 16, 256])
def test_the_default_covers_most_of_a_photograph(trials):
    sensor = jl.Sensor(frames=trials)
    bits = sensor.expose(CAMERA, rng=1)
    known = jl.uncertainty(bits, confidence_level=0.9)
    assert 0.75 < covered(known, CAMERA) < 0.99
    estimate = jl.reconstruct(bits)
    assert (known.low <= estimate).all()
    assert (estimate <= known.high).all()
    error = np.sqrt(np.mean((estimate - CAMERA) ** 2))
    assert 0.5 < np.sqrt(np.mean(known.standard_error.astype(float) ** 2)) / error < 2


@pytest.mark.parametrize("method", ["noniterative-tv", "network-two-layer", "admm-tv"])
def test_intervals_of_other_methods_contain_most_pixels(method):
    known = jl.uncertainty(COUNTS, SENSOR, method=method, confidence_level=0.9)
    assert 0.8 < covered(known, CAMERA) < 0.99


def test_a_function_of_the_caller_has_wider_intervals_where_it_errs():
    def shifted(counts, sensor):
        return np.clip(jl.pretrained(sensor).reconstruct(counts) + 0.2, 0, 1)

    known = jl.uncertainty(COUNTS, SENSOR, method=shifted, confidence_level=0.9)
    own = jl.uncertainty(COUNTS, SENSOR, confidence_level=0.9)
    assert covered(known, CAMERA) > 0.8
    assert np.median(known.high - known.low) > 1.5 * np.median(own.high - own.low)


def test_the_object_of_a_measured_network_has_the_intervals_of_its_name():
    for quality in ("medium", "large"):
        known = jl.uncertainty(COUNTS, SENSOR, quality=quality)
        same = jl.uncertainty(COUNTS, SENSOR, method=jl.pretrained(SENSOR, quality))
        np.testing.assert_array_equal(known.low, same.low)
        np.testing.assert_array_equal(known.high, same.high)


def changed_knots(network):
    first, *others = network.layers
    assert first.coefficients is not None
    first = dataclasses.replace(first, start=1.5 * first.start, spacing=1.5 * first.spacing)
    return [first, *others], network.trials_range


def changed_wiring(network):
    layers = list(network.layers)
    index = next(number for number, layer in enumerate(layers) if layer.skip is not None)
    layers[index] = dataclasses.replace(layers[index], skip=None)
    return layers, network.trials_range


def changed_range(network):
    return network.layers, (1, 128)


@pytest.mark.parametrize("change", [changed_knots, changed_wiring, changed_range])
def test_a_changed_network_is_not_taken_for_the_measured_one(change):
    layers, trials_range = change(jl.pretrained(SENSOR))
    changed = jl.Network(layers, SENSOR, trials_range=trials_range)
    estimate = jl.reconstruct(COUNTS[:32, :32], SENSOR)
    known = jl.uncertainty(COUNTS[:32, :32], SENSOR, method=changed, estimate=estimate)
    same = jl.uncertainty(COUNTS[:32, :32], SENSOR, method="mle-iterative", estimate=estimate)
    np.testing.assert_array_equal(known.low, same.low)


def test_the_errors_of_an_own_network_are_not_taken_for_measured_ones():
    sensor = jl.Sensor(frames=64)
    counts = sensor.expose(CAMERA, rng=0).counts()
    own = jl.Network.conditional("small", rng=0)
    known = jl.uncertainty(counts, sensor, method=own, confidence_level=0.9)
    same = jl.uncertainty(
        counts,
        sensor,
        method=lambda counts, sensor: own.reconstruct(counts, sensor),
        confidence_level=0.9,
    )
    np.testing.assert_array_equal(known.low, same.low)
    assert covered(known, CAMERA) > 0.85


@pytest.mark.parametrize(
    ("estimate", "message"),
    [
        (255 * CAMERA, "expected intensities from 0 to 1, got a mean of"),
        (-CAMERA, "expected intensities from 0 to 1, got a mean of -"),
        (np.full(CAMERA.shape, np.nan), "expected finite intensities"),
        (np.zeros((3, 3)), r"expected shape \(96, 96\), got \(3, 3\)"),
    ],
)
@pytest.mark.parametrize("method", [None, "mle"])
def test_an_estimate_that_does_not_fit_is_refused(estimate, message, method):
    with pytest.raises(ValueError, match=f"estimate: {message}"):
        jl.uncertainty(COUNTS, SENSOR, method=method, estimate=estimate)


def test_a_known_estimate_is_not_computed_again():
    def fails(counts):
        raise AssertionError

    estimate = jl.reconstruct(COUNTS, SENSOR, method="noniterative-tv")
    known = jl.uncertainty(COUNTS, SENSOR, method=fails, estimate=estimate)
    same = jl.uncertainty(COUNTS, SENSOR, method="noniterative-tv")
    np.testing.assert_array_equal(known.low, same.low)


def test_stacks_and_colors_are_those_of_single_images():
    stack = np.stack([COUNTS, COUNTS[::-1]])
    known = jl.uncertainty(stack, SENSOR)
    for index in range(2):
        single = jl.uncertainty(stack[index], SENSOR)
        np.testing.assert_array_equal(known.low[index], single.low)
        np.testing.assert_array_equal(known.high[index], single.high)
    color = jl.uncertainty(np.moveaxis(stack, 0, -1), SENSOR, channel_axis=-1)
    np.testing.assert_array_equal(color.standard_error, np.moveaxis(known.standard_error, 0, -1))


@pytest.mark.parametrize("dark_counts", [0.0, 0.01])
def test_pixels_beside_lamps_are_unlit_only_if_dark_counts_explain_their_ones(dark_counts):
    image = 0.1 + 0.4 * jl.datasets.photograph("camera")[128:384:4, 128:384:4]
    image[:, 56:] = 0
    image[18:24, 28:34] = 8
    sensor = jl.Sensor(frames=16, gain=8.0, max_intensity=8.0, dark_counts=dark_counts)
    bits = sensor.expose(image, rng=0)
    found, counts = jl.uncertainty(bits), bits.counts()
    explained = binom.sf(counts - 1, 16, 1 - np.exp(-dark_counts)) >= 0.025
    reaches_0 = found.low <= 0
    assert (reaches_0 & ~explained)[:, :56].any()
    np.testing.assert_array_equal(found.unlit, reaches_0 & explained)
    assert found.unlit[:, 58:].mean() > 0.8


@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
def test_units_scale_the_interval():
    known = jl.uncertainty(COUNTS, SENSOR)
    photons = jl.uncertainty(COUNTS, SENSOR.replace(gain=8.0), units="photons")
    same = jl.uncertainty(COUNTS, SENSOR.replace(gain=8.0))
    np.testing.assert_allclose(photons.high, same.high * 0.5, rtol=1e-6)
    assert known.standard_error.shape == CAMERA.shape


def test_maps_of_jots_and_dead_jots_are_taken_into_account():
    efficiency = np.where(np.arange(96) < 48, 0.4, 1.0) * np.ones((96, 96))
    mask = np.zeros((96, 96), bool)
    mask[5, 7] = True
    sensor = jl.Sensor(frames=16, efficiency=efficiency, dark_counts=0.02, mask=mask)
    bits = sensor.expose(CAMERA, rng=0)
    with pytest.warns(jl.JotlightWarning, match="inpainted|filled"):
        known = jl.uncertainty(bits, confidence_level=0.9)
    assert np.argwhere(known.dead).tolist() == [[5, 7]]
    assert np.isfinite(known.standard_error).all()
    assert 0.75 < covered(known, CAMERA) < 0.99


def test_more_trials_narrow_the_interval():
    widths = []
    for trials in (2, 8, 32, 128):
        sensor = jl.Sensor(frames=trials)
        known = jl.uncertainty(sensor.expose(CAMERA, rng=0))
        widths.append(np.median(known.high - known.low))
    assert widths == sorted(widths, reverse=True)


def test_a_scene_unlike_photographs_has_wider_intervals():
    noise = np.random.default_rng(0).uniform(0.2, 0.8, (128, 128))
    bits = jl.Sensor(frames=64).expose(noise, rng=0)
    known = jl.uncertainty(bits, confidence_level=0.9)
    assert 0.8 < covered(known, noise) < 0.99


def test_a_smooth_kernel_is_refused_except_for_maximum_likelihood():
    sensor = jl.Sensor(oversampling=2, frames=8, kernel="linear")
    bits = sensor.expose(CAMERA[:16, :16], rng=0)
    with pytest.raises(ValueError, match="got linear: the errors of its estimates are unknown"):
        jl.uncertainty(bits)
    with pytest.warns(jl.JotlightWarning, match="linear kernel"):
        jl.uncertainty(bits, method="mle")


@pytest.mark.parametrize("level", [0.3, 1, np.nan, "0.9", None, [0.9, 0.95]])
def test_a_bad_confidence_level_is_refused(level):
    with pytest.raises(ValueError, match=r"confidence_level: expected a coverage from 0\.5"):
        jl.uncertainty(COUNTS, SENSOR, confidence_level=level)


def test_a_confidence_level_in_percent_gets_the_fraction():
    with pytest.raises(ValueError, match=r"got 95; write 0\.95 for 95 %"):
        jl.uncertainty(COUNTS, SENSOR, confidence_level=95)


def test_bits_that_speak_against_the_estimate_are_flagged():
    rows, columns = np.indices((96, 96))
    board = 0.1 + 0.8 * ((rows + columns) % 2)
    sensor = jl.Sensor(frames=64)
    known = jl.uncertainty(sensor.expose(board, rng=0))
    assert known.unlikely.mean() > 0.9
    assert (known.flags() & 8 > 0).mean() > 0.9
    assert not jl.uncertainty(COUNTS, SENSOR).unlikely.any()
    assert not jl.uncertainty(sensor.expose(board, rng=0), method="mle").unlikely.any()
    blend = jl.reconstruct(sensor.expose(board, rng=0), method="held-out")
    assert jl.metrics.psnr(blend, board) > 20


def test_the_flags_of_noise_alone_are_rare():
    flat = np.full((128, 128), 0.4)
    fractions = [
        jl.uncertainty(jl.Sensor(frames=trials).expose(flat, rng=trials)).unlikely.mean()
        for trials in (4, 16, 64)
    ]
    assert max(fractions) < 0.005


def fields(known):
    return [known.standard_error, known.low, known.high, known.flags()]


@pytest.mark.slow
@pytest.mark.parametrize("mosaic", [None, "RGGB"])
def test_the_interval_in_a_precision_is_that_of_the_estimate_in_it(mosaic):
    sensor = SENSOR.replace(mosaic=mosaic)
    image = CAMERA if mosaic is None else np.stack([CAMERA, 0.7 * CAMERA, 0.4 * CAMERA], -1)
    bits = sensor.expose(image, rng=3, channel_axis=None if mosaic is None else -1)
    found, f32 = jl.uncertainty(bits, precision="bf16"), jl.uncertainty(bits)
    estimate = jl.reconstruct(bits, precision="bf16")
    expected = jl.uncertainty(bits, estimate=estimate)
    for one, other in zip(fields(found), fields(expected), strict=True):
        np.testing.assert_array_equal(one, other)
    assert (found.low <= estimate).all()
    assert (estimate <= found.high).all()
    assert (found.low != f32.low).any()


def test_maximum_likelihood_has_no_precision():
    with pytest.raises(ValueError, match="precision: expected f32 for mle, got bf16"):
        jl.uncertainty(COUNTS, SENSOR, method="mle", precision="bf16")
