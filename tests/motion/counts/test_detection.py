"""Detection of motion: static scenes stay below the threshold, whatever else changes."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.motion.counts import detection
from jotlight.motion.counts.detection import THRESHOLD, motion_score
from jotlight.sensing.parameters.provenance import Provenance

PHOTO = jl.datasets.photograph("camera")[100:292, 150:342]


def expose(image, frames, photons, rng, **sensor):
    exact = jl.Sensor(frames=frames, **sensor)
    return exact.replace(gain=frames * photons / image.mean()).expose(image, rng)


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["shake", "rotate", "layers"])
@pytest.mark.parametrize(("frames", "photons"), [(64, 0.1), (300, 0.4)])
def test_moving_scenes_are_detected(motion, frames, photons):
    scene = jl.datasets.moving(
        PHOTO, motion, sensor=jl.Sensor(frames=frames), shape=(128, 120), photons=photons, rng=2
    )
    assert motion_score(scene.bits) > THRESHOLD


@pytest.mark.parametrize("frames", [2, 3, 16, 200])
@pytest.mark.parametrize("photons", [0.02, 0.3, 2.0])
def test_static_scenes_are_not(frames, photons):
    for seed in range(5):
        assert motion_score(expose(PHOTO, frames, photons, seed)) < THRESHOLD


def test_flicker_is_not_motion():
    rng = np.random.default_rng(0)
    parts = []
    for _ in range(10):
        light = PHOTO * np.linspace(*rng.uniform(0.7, 1.3, 2), PHOTO.shape[1])
        parts.append(expose(light, 20, 0.5 * light.mean() / PHOTO.mean(), rng).packed)
    bits = jl.Bits(np.concatenate(parts), PHOTO.shape[1])
    counts = [bits[first : first + 20].counts().mean() for first in range(0, 200, 20)]
    assert max(counts) > 1.2 * min(counts)
    assert motion_score(bits) < THRESHOLD


def test_hot_jots_that_switch_and_afterpulsing_are_not_motion():
    rng = np.random.default_rng(1)
    frames = expose(PHOTO, 200, 0.2, rng).to_array()
    for _ in range(400):
        row, column = rng.integers(len(PHOTO), size=2)
        start = rng.integers(150)
        frames[start : start + 50, row, column] = True
    assert motion_score(jl.Bits.from_array(frames)) < THRESHOLD
    frames[1:] |= frames[:-1] & (rng.random(frames[1:].shape) < 0.1)
    assert motion_score(jl.Bits.from_array(frames)) < THRESHOLD


@pytest.mark.parametrize("threshold", [2, 4])
def test_other_thresholds_are_served(threshold):
    sensor = jl.Sensor(frames=50, gain=50 * 3.0, threshold=threshold)
    first = sensor.expose(PHOTO, 3).packed
    brighter = sensor.replace(gain=50 * 3.6).expose(PHOTO, 4).packed
    bits = jl.Bits(np.concatenate([first, brighter]), PHOTO.shape[1])
    assert bits[50:].counts().mean() > 1.05 * bits[:50].counts().mean()
    assert motion_score(bits, threshold=threshold) < THRESHOLD
    moved = sensor.expose(np.roll(PHOTO, 4, axis=1), 4).packed
    bits = jl.Bits(np.concatenate([first, moved]), PHOTO.shape[1])
    assert motion_score(bits, threshold=threshold) > THRESHOLD


@pytest.mark.slow
@pytest.mark.parametrize(
    ("threshold", "change"), [(2, 0.5), (3, 0.5), (6, 0.1), (6, 0.2), (6, 0.5)]
)
def test_flicker_behind_thresholds_above_1_is_not_motion(threshold, change):
    """A cell with more contrast flickers more than another one with the same counts."""
    frames, rng = 200, np.random.default_rng(6)
    lights = 1 + change * np.sin(np.arange(frames) * 2 * np.pi / 77)
    rate = 1.5 * threshold * PHOTO / PHOTO.max()
    photons = rng.poisson(lights[:, None, None] * rate)
    assert abs(motion_score(jl.Bits.from_array(photons >= threshold), threshold=threshold)) < 4
    moved = np.stack([np.roll(rate, time // 20, axis=1) for time in range(frames)])
    photons = rng.poisson(lights[:, None, None] * moved)
    bits = jl.Bits.from_array(photons >= threshold)
    assert motion_score(bits, threshold=threshold) > THRESHOLD


@pytest.mark.slow
def test_counts_and_colors_are_detected_as_bits_are():
    scene = jl.datasets.moving(
        PHOTO, "shake", sensor=jl.Sensor(frames=96), shape=(64, 70), photons=0.3, rng=2
    )
    frames = scene.bits.to_array()
    counts = frames.reshape(24, 4, 64, 70).sum(axis=1)
    stack = CountStack(counts, Provenance("npy", "a.npy"), trials=4)
    assert motion_score(stack) > THRESHOLD
    unknown = CountStack(counts, Provenance("npy", "a.npy"))
    with pytest.raises(ValueError, match="unknown number of trials"):
        motion_score(unknown)
    singles = CountStack(frames.astype(np.uint8), Provenance("npy", "a.npy"), trials=1)
    assert motion_score(singles) == motion_score(scene.bits)
    colors = jl.Bits.from_array(np.stack([frames] * 3, axis=3))
    assert motion_score(colors) > THRESHOLD


@pytest.mark.parametrize("shape", [(1, 64, 64), (50, 15, 64), (50, 64, 9), (4, 16, 16)])
@pytest.mark.parametrize("value", [0, 1])
def test_captures_without_information_score_zero(shape, value):
    assert motion_score(jl.Bits.from_array(np.full(shape, value))) == 0


def test_data_of_another_type_are_refused():
    with pytest.raises(TypeError, match="Bits"):
        motion_score(np.zeros((4, 32, 32)))


def test_the_score_is_that_of_all_pairs_of_neighbors(monkeypatch):
    deviations = np.random.default_rng(0).standard_normal((3, 5, 6))
    products = []
    for row in range(5):
        for column in range(6):
            for down, right in detection._NEIGHBORS:
                if row + down < 5 and 0 <= column + right < 6:
                    other = deviations[:, row + down, column + right]
                    products.append(deviations[:, row, column] @ other)
    expected = np.sum(products) / np.sqrt(np.sum(np.square(products)))
    assert detection._score(deviations) == pytest.approx(expected)


@pytest.mark.parametrize("shape", [(7, 30), (2, 12, 11)])
def test_sums_over_windows_match_loops(shape):
    values = np.random.default_rng(0).random(shape)
    found, half = detection._window_sums(values), detection._WINDOW // 2
    for row in range(shape[-2]):
        for column in range(shape[-1]):
            rows = slice(max(0, row - half), row + half + 1)
            columns = slice(max(0, column - half), column + half + 1)
            expected = values[..., rows, columns].sum(axis=(-2, -1))
            np.testing.assert_allclose(found[..., row, column], expected)
