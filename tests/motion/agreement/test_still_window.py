"""A wrong motion loses against a window without motion, and the true one does not."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.agreement.held_out import Fold, count_in_place
from jotlight.motion.agreement.still_window import find_window, look_hot, report_window
from moving import blocks_of, moved, paths_of, record, shaken, total_of


def test_the_true_motion_is_better_than_any_window():
    _, blocks, shifts, reference = shaken()
    paths = paths_of(blocks, shifts, reference)
    assert find_window(paths, total_of(paths)) is None


def test_a_wrong_motion_is_worse_than_a_window():
    bits, blocks, shifts, reference = shaken()
    paths = paths_of(blocks, -2 * shifts, reference)
    window = find_window(paths, total_of(paths))
    assert window is not None
    assert window.start <= reference < window.stop
    assert len(window) < len(bits)
    counted = count_in_place(paths, window)
    expected = bits[window.start : window.stop].counts()
    np.testing.assert_array_equal(counted.ones, expected)
    assert (counted.trials == len(window)).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "photons", "has_window"),
    [("shake", 0.3, True), ("static", 0.3, False), ("shake", 0.03, False)],
)
def test_a_scene_that_moves_unnoticed_has_a_window_if_there_are_enough_bits(
    motion, photons, has_window
):
    _, bits = record(motion, 64, shape=(160, 160), photons=photons, rng=0)
    blocks = blocks_of(bits)
    paths = paths_of(blocks, np.zeros((len(blocks.centers), 2)), 32)
    window = find_window(paths, total_of(paths))
    assert (window is not None) == has_window
    assert window is None or (len(window) <= 32 and window.start <= 32 < window.stop)


@pytest.mark.parametrize("frames", [1, 2, 5, 15])
def test_few_frames_without_motion_have_no_window(frames):
    _, bits = record("static", frames, shape=(160, 160), photons=3, rng=0)
    blocks = blocks_of(bits, 1)
    paths = paths_of(blocks, np.zeros((len(blocks.centers), 2)), frames // 2)
    assert find_window(paths, total_of(paths)) is None


@pytest.mark.parametrize(
    ("model", "expected"),
    [("none", "the frames differ although"), ("affine", "the motion does not explain the scene")],
)
def test_a_window_is_reported(model, expected):
    with pytest.warns(jl.JotlightWarning, match=f"{expected}.*; only 8 frames are used"):
        report_window(range(4, 12), model)


@pytest.mark.slow
@pytest.mark.parametrize(("pixels_per_frame", "rng"), [(0.012, 0), (0.016, 2)])
def test_the_true_motion_of_a_dim_slow_scene_is_better_than_any_window(pixels_per_frame, rng):
    frames = 256
    velocity = pixels_per_frame, pixels_per_frame / 2
    shifts = np.outer(np.arange(frames) - frames // 2, velocity)
    _, bits = moved(shifts, shape=(160, 160), photons=0.03, rng=rng)
    blocks = blocks_of(bits)
    times = blocks.centers - frames // 2
    paths = paths_of(blocks, np.outer(times, velocity), frames // 2)
    assert find_window(paths, total_of(paths)) is None


def paths_that_drift(pixels_per_frame, photons, rng, frames=64):
    """Return the paths of a static scene along a wrong motion of constant velocity."""
    _, bits = record("static", frames, shape=(160, 160), photons=photons, rng=rng)
    blocks = blocks_of(bits)
    shifts = np.outer(blocks.centers - frames // 2, [0, pixels_per_frame])
    return paths_of(blocks, shifts, frames // 2)


@pytest.mark.slow
def test_every_second_frame_in_the_middle_is_held_out(monkeypatch):
    held = []
    fold = Fold.of

    def spy(paths, total, frames, compared):
        held.append(list(frames))
        return fold(paths, total, frames, compared)

    monkeypatch.setattr(Fold, "of", spy)
    for frames, expected in ((64, [28, 30, 32, 34]), (32, [14, 16]), (16, [7])):
        paths = paths_that_drift(0.5, 0.3, 0, frames)
        held.clear()
        find_window(paths, total_of(paths))
        assert held == [expected, [time + 1 for time in expected]]


@pytest.mark.slow
def test_a_slow_wrong_motion_of_a_dim_scene_is_worse_than_a_window():
    for rng in range(3):
        paths = paths_that_drift(0.4, 0.05, rng)
        assert find_window(paths, total_of(paths)) is not None


def hot_paths(speed):
    """Return the paths of a shaking camera with many hot jots, and where these are.

    The motion is the true one times `speed`.
    """
    scene, bits = record("shake", photons=0.2)
    rng = np.random.default_rng(0)
    hot = rng.random(bits.shape[1:]) < 0.05
    seen = bits.to_array() | (hot & (rng.random(bits.shape) < 0.9))
    blocks = blocks_of(jl.Bits.from_array(seen))
    shifts = np.stack([speed * scene.motion(time)[:, 0, 0] for time in blocks.centers])
    return paths_of(blocks, shifts, scene.reference), hot


def test_hot_jots_do_not_hide_that_the_motion_is_right():
    paths, hot = hot_paths(1)
    assert find_window(paths, total_of(paths)) is None
    found = look_hot(count_in_place(paths, range(48)))
    assert found[hot].mean() > 0.9
    assert found[~hot].mean() < 0.005


def test_hot_jots_do_not_hide_that_the_motion_is_wrong():
    paths, _ = hot_paths(-2)
    assert find_window(paths, total_of(paths)) is not None
