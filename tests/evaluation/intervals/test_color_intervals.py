"""The uncertainty of colors behind a mosaic: coverage, densities, halves, and bad input."""

import dataclasses
import functools

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.intervals.color_intervals import MosaicPixels
from jotlight.evaluation.intervals.error_scale import COLOR_FILE, error_model
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.reading_groups import without_mosaic

IMAGE = jl.datasets.photograph("astronaut")[100:164, 180:244].astype(np.float64)
RANDOM = Mosaic(np.random.default_rng(3).choice(4, IMAGE.shape[:2], p=[0.1, 0.1, 0.1, 0.7]), "RGBW")


def expose(mosaic="RGGB", trials=16, image=IMAGE, **parameters):
    sensor = jl.Sensor(frames=trials, mosaic=mosaic, **parameters)
    return sensor.expose(image, rng=1, channel_axis=-1)


@functools.cache
def known_of(level=0.95):
    """Return the bits of the photograph behind RGGB, and their uncertainty."""
    bits = expose()
    return bits, jl.uncertainty(bits, confidence_level=level)


def pixels_of(bits):
    gray = without_mosaic(bits.sensor)
    counted = count_pixels(bits.counts(), gray, None)
    return MosaicPixels.of(counted, bits.sensor.mosaic)


def covered(known, image=IMAGE):
    return float(((known.low <= image) & (image <= known.high)).mean())


@pytest.mark.slow
def test_a_color_has_the_trials_of_the_pixels_that_see_it():
    # Behind RGGB, green has the threshold 1, and red and blue 3, which say little in the dark.
    board = np.where(np.indices(IMAGE.shape[:2]).sum(axis=0) % 2, 1, 3)
    bits = expose("RGGB", threshold=board)
    known = jl.uncertainty(bits, confidence_level=0.9)
    inside = (known.low <= IMAGE) & (known.high >= IMAGE)
    dark = np.quantile(IMAGE, 1 / 3) >= IMAGE
    assert 0.85 < inside.mean() < 0.98
    assert 0.82 < inside[dark].mean() < 0.98


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mosaic", "trials"),
    [
        ("RGGB", 16),
        (RANDOM, 16),
        ("RGGB", 1),
        ("RGBW", 64),
    ],
)
def test_the_intervals_cover_most_of_a_photograph(mosaic, trials):
    bits = expose(mosaic, trials)
    known = jl.uncertainty(bits, confidence_level=0.9)
    assert known.low.shape == IMAGE.shape
    assert 0.8 < covered(known) < 0.985
    estimate = jl.reconstruct(bits)
    assert (known.low <= estimate).all()
    assert (estimate <= known.high).all()
    wider = jl.uncertainty(bits, confidence_level=0.99)
    assert (wider.low <= known.low).all()
    assert (known.high <= wider.high).all()
    assert covered(wider) > covered(known)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"method": "mle"},
        {"quality": "small"},
        ({"demosaicing": "differences"}),
    ],
)
def test_other_methods_have_wider_intervals(options):
    bits, own = known_of(0.9)
    if "method" in options:
        options = options | {"demosaicing": "differences"}
    known = jl.uncertainty(bits, confidence_level=0.9, **options)
    assert np.median(known.high - known.low) > np.median(own.high - own.low)
    assert 0.75 < covered(known) < 0.99
    estimate = jl.reconstruct(bits, **options)
    assert ((known.low <= estimate) & (estimate <= known.high)).all()


@pytest.mark.slow
def test_the_known_estimate_is_the_center():
    bits, known = known_of()
    estimate = jl.reconstruct(bits)
    again = jl.uncertainty(bits, estimate=estimate)
    np.testing.assert_array_equal(again.low, known.low)


@pytest.mark.slow
def test_the_densities_are_those_of_least_squares():
    densities = pixels_of(expose("RGGB")).densities
    np.testing.assert_allclose(densities, [0.25, 0.5, 0.25])
    # Monte Carlo: the variance of least-squares colors of a constant image behind CMYG.
    pixels = pixels_of(expose("CMYG"))
    shares = pixels.shares.reshape(3, -1).T
    rng = np.random.default_rng(0)
    noisy = shares @ [0.5, 0.4, 0.3] + rng.standard_normal((1000, len(shares)))
    found = np.linalg.lstsq(shares, noisy.T, rcond=None)[0]
    expected = 1 / (pixels.densities * len(shares))
    np.testing.assert_allclose(found.var(axis=1), expected, rtol=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_held_out_bits_correct_the_scale(factor):
    """Where the errors of halves are larger than the model expects, the scale grows with them."""
    bits = expose(trials=64)
    weights = np.zeros(36)
    weights[0] = np.log(0.05)
    model = dataclasses.replace(error_model(COLOR_FILE), weights=weights, deviation=np.ones(8))
    pixels = pixels_of(bits)
    colors = pixels.estimate()
    rng = np.random.default_rng(0)
    halves = []
    for _, trained, held_out in pixels.halves():
        # The truth, moved at random by `factor` times the model's scale.
        moved = np.empty_like(colors)
        for color in range(3):
            z = pixels.colors_of(color).stabilize(IMAGE[..., color])
            error = factor * 0.05 * rng.standard_normal(z.shape)
            light = -np.log(np.cos(np.clip(z + error, 0.01, 1.5)) ** 2)
            moved[..., color] = light / bits.sensor.light_per_intensity
        halves.append((moved, trained, held_out))
    plain, _ = pixels.scale(model, colors, [])
    found, _ = pixels.scale(model, colors, halves)
    for one, other in zip(found, plain, strict=True):
        assert np.median(one / other) == pytest.approx(factor, rel=0.3)


@pytest.mark.slow
def test_white_balance_and_units_scale_the_intervals():
    plain = expose(image=0.3 * IMAGE)
    balanced = Mosaic("RGGB", white_balance=[2.0, 1.0, 0.5])
    sensor = plain.sensor.replace(mosaic=balanced, gain=plain.sensor.gain)
    bits = jl.Bits(plain.packed, plain.width, sensor)
    known, scaled = jl.uncertainty(plain), jl.uncertainty(bits)
    np.testing.assert_allclose(
        scaled.low, known.low * np.float32([2, 1, 0.5]), rtol=1e-3, atol=1e-5
    )
    photons = jl.uncertainty(plain, units="photons")
    factor = plain.sensor.light_per_intensity
    np.testing.assert_allclose(photons.standard_error, factor * known.standard_error, rtol=1e-6)


@pytest.mark.slow
def test_stacks_and_dead_and_saturated_pixels():
    mask = np.zeros(IMAGE.shape[:2], bool)
    mask[10:12, 20] = True
    bright = IMAGE.copy()
    bright[40:60, 40:60] = 30.0
    bits = expose(image=bright, mask=mask)
    with pytest.warns(jl.JotlightWarning, match="no valid bit|clips"):
        known = jl.uncertainty(bits)
    assert known.dead[10, 20].all()
    assert known.dead.sum() == 3 * mask.sum()
    # RGGB: a red pixel says nothing about green.
    assert known.saturated[44, 44].tolist() == [True, False, False]
    assert known.saturated[44, 45].tolist() == [False, True, False]
    counts = np.stack([expose().counts(), expose(trials=16, image=IMAGE[::-1]).counts()])
    stack = jl.uncertainty(counts, jl.Sensor(frames=16, mosaic="RGGB"))
    assert stack.low.shape == (2, *IMAGE.shape)
    np.testing.assert_array_equal(stack.low[0], known_of()[1].low)


@pytest.mark.slow
def test_a_scene_unlike_photographs_is_unlikely():
    noise = np.random.default_rng(0).random(IMAGE.shape)
    strange = jl.uncertainty(expose(trials=64, image=noise)).unlikely.mean()
    usual = jl.uncertainty(expose(trials=64)).unlikely.mean()
    assert strange > 0.5 > 0.05 > usual


def test_halves_of_a_tiny_image_may_lack_a_color():
    sensor = jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0], mosaic="RGBW")
    known = jl.uncertainty(sensor.expose(np.full((2, 2, 3), 0.4), rng=0))
    assert (known.low < known.high).all()


def test_bad_input_is_refused():
    bits = expose()
    many = jl.Sensor(frames=4096, mosaic="RGGB")
    with pytest.raises(ValueError, match=r"up to 1,000 trials per pixel.*got 4,096"):
        jl.uncertainty(np.ones((8, 8), int), many)
    with pytest.raises(ValueError, match="demosaicing: is for a sensor with a mosaic"):
        jl.uncertainty(np.ones((8, 8), int), jl.Sensor(frames=4), demosaicing="menon")
    with pytest.raises(ValueError, match=r"estimate: expected shape \(64, 64, 3\)"):
        jl.uncertainty(bits, estimate=np.ones((64, 64)))
    with pytest.raises(ValueError, match="confidence_level"):
        jl.uncertainty(bits, confidence_level=1.0)


@pytest.mark.parametrize(
    "options",
    [
        [],
        pytest.param(
            ["--demosaicing", "differences", "--quality", "medium"], marks=pytest.mark.slow
        ),
    ],
)
def test_the_command_line_writes_the_intervals(run, tmp_path, options):
    bits = expose()
    jl.save(bits, tmp_path / "bits.npy")
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--uncertainty", "u.npz"]
    status, output = run(*arguments, "--level", 0.9, *options)
    assert status == 0, output
    chosen = {"demosaicing": "differences", "quality": "medium"} if options else {}
    known = jl.uncertainty(jl.open(tmp_path / "bits.npy"), confidence_level=0.9, **chosen)
    with np.load(tmp_path / "u.npz") as written:
        np.testing.assert_allclose(written["low"], known.low, atol=1e-5)
        np.testing.assert_array_equal(written["flags"], known.flags())


@pytest.mark.slow
def test_readings_have_intervals_wherever_the_color_network_takes_them():
    readings = expose(RANDOM, trials=1, bit_depth=8, gain=100.0)
    # Clear pixels have more than 1,000 equivalent trials.
    estimate, info = jl.reconstruct(readings, return_info=True)
    assert info.method == "network-color"
    known = jl.uncertainty(readings)
    assert ((known.low <= estimate) & (estimate <= known.high)).mean() > 0.9
    assert covered(known) > 0.7
