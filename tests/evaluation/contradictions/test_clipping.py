"""Scenes that are brighter than the largest intensity S are reported, and no others."""

import re

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets import photograph
from jotlight.errors import hide_warnings
from jotlight.evaluation.contradictions.bright_pixels import bright_pixels
from jotlight.sensing.data.pixel_counts import gray_images

SCENE = photograph("camera")[::4, ::4]
MESSAGE = r"([\d,]+) of ([\d,]+) pixels are brighter than the largest intensity, 1, which clips"
ALL = r"^([\d,]+) of \1 pixels are brighter"
BRACKET = np.repeat([64.0, 8.0, 1.0], 16)


def expose(sensor, scene=3 * SCENE, **changes):
    """Return bits of a scene up to 4, which state that S is 1."""
    bits = sensor.replace(max_intensity=4.0).expose(scene, rng=0)
    return bits.replace(sensor=sensor, **changes)


@pytest.mark.parametrize("method", ["mle", "network-small", "noniterative-tv"])
def test_a_bright_scene_is_reported(method):
    bits = expose(jl.Sensor(frames=64))
    with pytest.warns(jl.JotlightWarning, match=MESSAGE + r".*\(max_intensity=4\.85\)") as caught:
        estimate = jl.reconstruct(bits, method=method)
    number, size = re.match(MESSAGE, str(caught[0].message)).groups()
    assert size == "16,384"
    assert 0.6 < int(number.replace(",", "")) / SCENE.size < 0.75
    assert (estimate == 1).mean() > 0.6


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=2, oversampling=2),
        jl.Sensor(frames=64, threshold=2),
        jl.Sensor(frames=64, efficiency=np.full((128, 128), 0.5), dark_counts=0.1),
        jl.Sensor(frames=16, oversampling=2, efficiency=np.tile([[0.5, 0.9]], (256, 128))),
        jl.Sensor(frames=48, gain=BRACKET),
        jl.Sensor(frames=8, bit_depth=4),
        jl.Sensor(frames=64, read_noise=0.2),
    ],
    ids=["4 bits", "threshold", "map", "jots", "bracket", "several bits", "read noise"],
)
@pytest.mark.parametrize("run", [jl.reconstruct, jl.uncertainty])
@pytest.mark.filterwarnings("ignore:read_noise")
def test_all_readings_are_compared(sensor, run):
    bits = expose(sensor) if sensor.bit_depth == 1 else sensor.expose(3 * SCENE, rng=0)
    with pytest.warns(jl.JotlightWarning, match=MESSAGE):
        run(bits, method="mle")
    white = SCENE / SCENE.max()
    run(sensor.expose(np.where(white > 0.6, 1.0, white), rng=1), method="mle")


def test_merged_counts_and_stacks_are_compared():
    bits = expose(jl.Sensor(frames=64))
    merged = jl.Merged(bits.counts(), 64.0, bits.sensor)
    stack = np.stack([bits.counts(), np.zeros((128, 128), np.int32)])
    for data in (merged, stack):
        with pytest.warns(jl.JotlightWarning, match=MESSAGE):
            jl.reconstruct(data, bits.sensor, method="mle")


def test_equivalent_counts_are_reported_if_nearly_all_are_clipped():
    bits = expose(jl.Sensor(frames=48, gain=BRACKET))
    jl.reconstruct(jl.merge_readings(bits), method="mle")
    white = expose(jl.Sensor(frames=48, gain=BRACKET), np.full((16, 16), 3.0))
    with pytest.warns(jl.JotlightWarning, match=ALL):
        jl.reconstruct(jl.merge_readings(white), method="mle")


def test_different_jots_with_higher_thresholds_are_reported_if_nearly_all_are_clipped():
    maps = {"efficiency": np.tile([[0.5, 0.9]], (32, 16))}
    sensor = jl.Sensor(frames=64, oversampling=2, gain=640.0, threshold=2, **maps)
    with pytest.warns(jl.JotlightWarning, match=ALL):
        jl.reconstruct(expose(sensor, np.full((16, 16), 3.0)), method="mle")


@pytest.mark.parametrize("frames", [2, 16, 64, 2000])
@pytest.mark.parametrize("level", [0.9, 1.0])
def test_a_white_scene_is_not(frames, level):
    bits = jl.Sensor(frames=frames).expose(np.full((64, 64), level), rng=0)
    jl.reconstruct(bits, method="mle")
    jl.uncertainty(bits, method="mle")


def test_exact_intervals_of_equivalent_counts_are_to_be_merged_again():
    pixel = jl.FreeRunning(dead_time=0.01)
    merged = pixel.merge(pixel.draw(np.full((32, 32), 90.0), rng=0), 30.0)
    with pytest.warns(jl.JotlightWarning, match="merge the readings again"):
        jl.uncertainty(merged, method="mle")


STARS = jl.Sensor(frames=20_000, gain=1000.0, dark_counts=0.002)


def draw_stars(rng=0):
    """Return a dark scene with three stars of 5 x 5 pixels, whose middles are above S, and counts.

    Their bits are far below saturation: at the middle, 13 % are 1.
    """
    scene = np.full((64, 64), 0.04)
    for row, column, peak in ((10, 20, 2.9), (30, 31, 1.5), (63, 5, 0.8)):
        distance = np.hypot(*np.ogrid[-row : 64 - row, -column : 64 - column])
        scene += peak * np.exp(-(distance**2) / 2)
    return scene, STARS.expose(scene, rng=rng).counts()


@pytest.mark.slow
@pytest.mark.parametrize("method", [None, "mle", "network-medium", "admm-tv"])
def test_the_middle_of_a_star_is_reported(method):
    scene, counts = draw_stars()
    with pytest.warns(jl.JotlightWarning, match=MESSAGE + r".*\(max_intensity=212\)") as caught:
        jl.reconstruct(counts, STARS, method=method)
    number, size = re.match(MESSAGE, str(caught[0].message)).groups()
    assert (int(number), size) == (((scene > 1.3).sum()), "4,096")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
@pytest.mark.parametrize("method", [None, "mle", "network-medium", "admm-tv"])
def test_the_middle_of_a_star_counts_as_saturated(method):
    scene, counts = draw_stars()
    known = jl.uncertainty(counts, STARS, method=method)
    assert known.saturated[scene > 1.3].all()
    assert not known.saturated[scene < 0.9].any()
    assert (known.high[known.saturated] == 1).all()
    wide = STARS.replace(max_intensity=10.0)
    exact = jl.uncertainty(counts, wide, method="mle", confidence_level=0.9999)
    assert not exact.saturated.any()
    assert ((exact.low <= scene) & (scene <= exact.high)).all()


def test_readings_above_the_largest_intensity_count_as_saturated():
    sensor = jl.Sensor(frames=300, bit_depth=4, gain=600.0)
    scene = np.full((12, 12), 0.3)
    scene[4, 7] = 2.5
    readings = sensor.expose(scene, rng=0)
    with pytest.warns(jl.JotlightWarning, match=r"^1 of 144 pixels is brighter than the largest"):
        known = jl.uncertainty(readings, method="mle")
    assert np.argwhere(known.saturated).tolist() == [[4, 7]]


def test_half_of_a_white_scene_is_not_saturated():
    """The upper half of the exact intervals of white pixels is above S, but few intervals are."""
    sensor = jl.Sensor(frames=1000)
    known = jl.uncertainty(sensor.expose(np.ones((64, 64)), rng=0), method="mle")
    assert 0.01 < known.saturated.mean() < 0.04  # 2.5 % are expected


@pytest.mark.parametrize("frames", [1, 4, 64, 1000, 30_000])
def test_noise_does_not_make_a_white_image_bright(frames):
    rng = np.random.default_rng(frames)
    counts = rng.binomial(frames, -np.expm1(-1.0), (4, 512, 512)).astype(np.int32)
    assert not bright_pixels(gray_images(counts), jl.Sensor(frames=frames)).any()


def test_a_region_of_few_readings_is_bright():
    counts = np.random.default_rng(1).binomial(4, -np.expm1(-1.0), (64, 64)).astype(np.int32)
    counts[16:32, 24:40] = np.random.default_rng(2).binomial(4, -np.expm1(-3.0), (16, 16))
    bright = bright_pixels(gray_images(counts), jl.Sensor(frames=4))[0]
    assert bright[16:32, 24:40].all()
    assert bright.sum() == 256


def test_saturated_bits_are_not():
    sensor = jl.Sensor(frames=64, max_intensity=4.0)
    bits = sensor.expose(np.full((64, 64), 4.0), rng=0)
    jl.reconstruct(bits.replace(packed=bits.packed | 255, sensor=sensor.replace(max_intensity=5)))


@pytest.mark.parametrize("method", [None, "mle"])
@pytest.mark.parametrize("mosaic", ["RGGB", "RGBW"])
def test_one_bright_color_is_reported(method, mosaic):
    sensor = jl.Sensor(frames=64, mosaic=mosaic)
    gray = np.full((64, 64), 0.2)
    white = np.stack([gray + 0.8, gray, gray], axis=-1)
    jl.reconstruct(sensor.expose(white, rng=0), method=method)
    red = np.stack([gray + 1.8, gray, gray], axis=-1)
    bits = expose(sensor, red)
    with pytest.warns(jl.JotlightWarning, match=MESSAGE):
        jl.reconstruct(bits, method=method)
    if method is None:
        with hide_warnings():
            known = jl.uncertainty(bits)
        is_red = bits.sensor.mosaic.full(64, 64) == bits.sensor.mosaic.full(64, 64)[0, 0]
        assert known.saturated[is_red, 0].all()
        assert not known.saturated[is_red, 1].any()
