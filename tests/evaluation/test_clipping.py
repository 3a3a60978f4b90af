"""Scenes that are brighter than the largest intensity S are reported, and no others."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets import photograph

SCENE = photograph("camera")[::4, ::4]
MESSAGE = r"(\d+)% of the scene is brighter than the largest intensity, 1, which clips"
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
    percentage = int(str(caught[0].message).split("%")[0])
    assert 60 < percentage < 75
    assert (estimate == 1).mean() > 0.6


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
    with pytest.warns(jl.JotlightWarning, match="^100% of the scene is brighter"):
        jl.reconstruct(jl.merge_readings(white), method="mle")


def test_different_jots_with_higher_thresholds_are_reported_if_nearly_all_are_clipped():
    maps = {"efficiency": np.tile([[0.5, 0.9]], (32, 16))}
    sensor = jl.Sensor(frames=64, oversampling=2, gain=640.0, threshold=2, **maps)
    with pytest.warns(jl.JotlightWarning, match="^100% of the scene is brighter"):
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


def test_a_few_lights_are_not():
    scene = np.array(SCENE)
    scene[:16, :32] = 3.0  # 3 % of the pixels
    jl.reconstruct(expose(jl.Sensor(frames=64), scene), method="mle")


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
    with pytest.warns(jl.JotlightWarning, match=MESSAGE):
        jl.reconstruct(expose(sensor, red), method=method)
