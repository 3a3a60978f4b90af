"""Merging onto a grid of half pixels: counts by brute force, and where the grid is not covered."""

import importlib

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.merging.finer import fine_frames
from jotlight.squares import repeat_squares
from moving import constant_motion, in_memory, moved

module = importlib.import_module("jotlight.motion.merge")

SIZE = 32, 48
FRAMES = 32
REFERENCE = 16


@pytest.fixture(autouse=True)
def _without_still_window(monkeypatch):
    """Merge along the motion in all cases, even where a sum without motion may be better."""
    monkeypatch.setattr(module, "find_window", lambda paths, total: None)


def motion_of(shifts):
    return constant_motion(shifts, SIZE, np.arange(FRAMES), REFERENCE)


def fine_sums(frames, shifts, valid=None):
    """Return the ones and trials of squares: a loop over frames.

    A jot at row y sees the position y - shift of the image, which is rounded to half pixels.
    """
    height, width = frames.shape[1:]
    valid = np.ones((height, width), bool) if valid is None else valid
    ones, trials = np.zeros((2, 2 * height, 2 * width), int)
    for frame, shift in zip(frames, shifts, strict=True):
        down, right = np.rint(2 * np.asarray(shift)).astype(int)
        places = np.argwhere(valid)
        squares = 2 * places - [down, right]
        inside = ((squares >= 0) & (squares < [2 * height, 2 * width])).all(axis=1)
        # No two jots of a frame see the same square.
        square = tuple(squares[inside].T)
        ones[square] += frame[tuple(places[inside].T)]
        trials[square] += 1
    return ones, trials


@pytest.mark.parametrize("width", [5, 8, 13, 64, 67])
def test_frames_are_placed_on_even_rows_and_columns(width):
    frames = np.random.default_rng(width).random((3, 4, width)) < 0.5
    expected = np.zeros((3, 8, 2 * width), bool)
    expected[:, ::2, ::2] = frames
    np.testing.assert_array_equal(
        fine_frames(np.packbits(frames, axis=2), width), np.packbits(expected, axis=2)
    )


@pytest.mark.parametrize("step", [(0.5, 0.0), (0.3, -0.7), (-1.0, 2.0)])
def test_counts_are_those_of_a_loop_over_jots(step):
    # Half of a half pixel would be rounded up or down by errors of arithmetic.
    shifts = np.outer(np.arange(FRAMES) - REFERENCE, step) + 0.01 * (np.array(step) != 0)
    _, bits = moved(shifts, shape=SIZE, photons=0.5, rng=0)
    merged = jl.merge(bits, motion=motion_of(shifts), upsample=2)
    ones, trials = fine_sums(bits.to_array(), shifts)
    assert merged.shape == merged.flags.shape == (64, 96)
    assert merged.upsample == 2
    complete = merged.acceptance == 1
    assert complete.mean() > 0.3
    np.testing.assert_array_equal(merged.ones[complete], ones[complete])
    np.testing.assert_array_equal(merged.trials[complete], trials[complete])
    assert (merged.trials <= trials).all()


def test_whole_shifts_cover_a_quarter_of_the_grid():
    """The readings are those of the merge onto the grid of the jots, and nothing is filled in."""
    shifts = np.outer(np.arange(FRAMES) - REFERENCE, (1, -1))
    _, bits = moved(shifts, shape=SIZE, photons=0.5, rng=0)
    coarse, fine = (jl.merge(bits, motion=motion_of(shifts), upsample=n) for n in (1, 2))
    covered = np.zeros(fine.shape, bool)
    covered[::2, ::2] = True
    assert (fine.trials[~covered] == 0).all()
    np.testing.assert_array_equal(fine.trials[::2, ::2], coarse.trials)
    np.testing.assert_array_equal(fine.ones[::2, ::2], coarse.ones)
    np.testing.assert_array_equal(fine.acceptance, repeat_squares(coarse.acceptance, 2))
    np.testing.assert_array_equal(
        fine.posterior_error, 2 * repeat_squares(coarse.posterior_error, 2)
    )


def test_no_reading_is_lost():
    """All bits of the coarse merge are on the finer grid, apart from the border."""
    scene = jl.datasets.moving(
        motion="shake", sensor=jl.Sensor(frames=48), shape=(64, 64), photons=0.5, rng=0
    )
    bits = in_memory(scene)
    motion = jl.align(bits)
    coarse, fine = (jl.merge(bits, motion=motion, upsample=n) for n in (1, 2))
    inner = slice(12, -12), slice(12, -12)
    squares = fine.trials.reshape(64, 2, 64, 2).sum(axis=(1, 3))
    assert squares[inner].mean() == pytest.approx(coarse.trials[inner].mean(), rel=0.01)
    # A shaken camera covers the whole grid.
    assert (fine.trials[24:-24, 24:-24] > 0).all()


@pytest.mark.slow
def test_dead_jots_and_maps_of_the_sensor_are_known_on_the_finer_grid():
    mask = np.random.default_rng(1).random(SIZE) < 0.1
    rows, columns = np.indices(SIZE)
    dark = 0.002 * rows + 0.001 * columns
    sensor = jl.Sensor(frames=FRAMES, gain=1.0 * FRAMES, mask=mask, dark_counts=dark)
    shifts = np.outer(np.arange(FRAMES) - REFERENCE, (0.3, -0.2)) + 0.01
    _, bits = moved(shifts, sensor=sensor, shape=SIZE, rng=0)
    merged = jl.merge(bits, motion=motion_of(shifts), upsample=2)
    ones, trials = fine_sums(bits.to_array(), shifts, ~mask)
    complete = merged.acceptance == 1
    np.testing.assert_array_equal(merged.ones[complete], ones[complete])
    np.testing.assert_array_equal(merged.trials[complete], trials[complete])
    # In the middle, a square sees the jots around it about equally often.
    inner = slice(20, -20), slice(20, -20)
    # Row r of the grid is at r/2 in pixels.
    expected = 0.001 * np.indices(merged.shape)[0] + 0.0005 * np.indices(merged.shape)[1]
    known = merged.trials[inner] > 4
    errors = (merged.dark_counts - expected)[inner][known]
    assert abs(np.median(errors)) < 0.002
    assert np.isfinite(jl.pretrained(sensor).reconstruct(merged)).all()


@pytest.mark.slow
def test_colors_have_a_finer_grid_each():
    shifts = np.outer(np.arange(FRAMES) - REFERENCE, (0.3, -0.2)) + 0.01
    _, bits = moved(shifts, shape=SIZE, photons=0.5, rng=0)
    frames = bits.to_array()
    colors = jl.Bits.from_array(np.stack([frames, frames, frames], axis=3))
    merged = jl.merge(colors, motion=motion_of(shifts), upsample=2)
    assert merged.shape == (64, 96, 3)
    ones, _ = fine_sums(frames, shifts)
    complete = merged.acceptance == 1
    np.testing.assert_array_equal(merged.ones[complete][:, 1], ones[complete])
    image = jl.reconstruct(merged)
    assert image.shape == (64, 96, 3)
    np.testing.assert_array_equal(image[..., 0], image[..., 2])


@pytest.mark.filterwarnings("ignore:the motion does not explain the scene")
def test_a_window_without_motion_covers_a_quarter_of_the_grid(monkeypatch):
    """Where the guard rejects the motion, the trials show that nothing is known in between."""
    monkeypatch.setattr(module, "find_window", lambda paths, total: range(12, 20))
    monkeypatch.setattr(module, "_MAX_FLAGGED", -1.0)
    shifts = np.outer(np.arange(FRAMES) - REFERENCE, (0.3, -0.2)) + 0.01
    _, bits = moved(shifts, shape=SIZE, photons=0.5, rng=0)
    merged = jl.merge(bits, motion=motion_of(shifts), upsample=2)
    np.testing.assert_array_equal(merged.ones[::2, ::2], bits[12:20].counts())
    assert (merged.trials[::2, ::2] == 8).all()
    assert merged.trials.sum() == 8 * 32 * 48
    assert merged.flags.all()


@pytest.mark.parametrize(
    ("sensor", "upsample", "message"),
    [
        (jl.Sensor(frames=16), 3, "upsample: expected a whole number from 1 to 2"),
        (jl.Sensor(frames=16), 0, "upsample: expected a whole number from 1 to 2"),
        (jl.Sensor(frames=16, oversampling=2), 2, "upsample: expected 1 for pixels of 2 x 2 jots"),
    ],
)
def test_other_grids_are_refused(sensor, upsample, message):
    bits = jl.Bits.from_array(np.zeros((16, 32, 32), bool), sensor)
    with pytest.raises(ValueError, match=message):
        jl.merge(bits, upsample=upsample)
