"""Merging along a known motion: sums and maps by brute force."""

import importlib
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from moving import aligned, constant_motion, moved, record

module = importlib.import_module("jotlight.motion.merge")

SIZE = 64, 96
FRAMES = 32


@pytest.fixture(autouse=True)
def _without_still_window(monkeypatch):
    """Merge along the motion in all cases, even where a sum without motion may be better."""
    monkeypatch.setattr(module, "find_window", lambda paths, total: None)


def shifts_of(step):
    """Return the shifts of a scene that moves by a step in each frame."""
    return np.outer(np.arange(FRAMES) - 16, step)


def motion_of(step, size=SIZE):
    return constant_motion(shifts_of(step), size, np.arange(FRAMES), 16)


def sums_of(bits, step, valid=None):
    """Return ones and trials of all pixels: a loop over frames and pixels."""
    array, (height, width) = bits.to_array(), bits.shape[1:]
    valid = np.ones((height, width), bool) if valid is None else valid
    ones, trials = np.zeros((height, width), int), np.zeros((height, width), int)
    for frame, (rows, columns) in enumerate(shifts_of(step)):
        for row, column in np.ndindex(height, width):
            y, x = row + rows, column + columns
            if 0 <= y < height and 0 <= x < width and valid[y, x]:
                ones[row, column] += array[frame, y, x]
                trials[row, column] += 1
    return ones, trials


def assert_sums(merged, ones, trials):
    """Check the sums of the pixels all of whose bits are accepted. Others have less."""
    complete = merged.acceptance == 1
    assert complete.mean() > 0.5
    np.testing.assert_array_equal(merged.ones[complete], ones[complete])
    np.testing.assert_array_equal(merged.trials[complete], trials[complete])
    assert (merged.trials <= trials).all()
    assert (merged.ones <= ones).all()


@pytest.mark.slow
@pytest.mark.parametrize("upsample", [1, 2])
def test_a_single_channel_keeps_its_axis(upsample):
    _, bits = moved(shifts_of((1, -2)), shape=SIZE, photons=0.4, rng=0)
    channel = jl.Bits.from_array(bits.to_array()[..., None], bits.sensor)
    motion = motion_of((1, -2))
    gray = jl.merge(bits, motion=motion, upsample=upsample)
    merged = jl.merge(channel, motion=motion, upsample=upsample)
    np.testing.assert_array_equal(merged.ones, gray.ones[..., None])
    np.testing.assert_array_equal(merged.trials, gray.trials[..., None])
    assert jl.reconstruct(merged).shape == (*gray.shape, 1)


@pytest.mark.slow
@pytest.mark.parametrize("step", [(1, -2), (-1, 0), (0, 3)])
def test_whole_shifts_give_the_sums_of_shifted_frames_bit_for_bit(step):
    _, bits = moved(shifts_of(step), shape=SIZE, photons=0.4, rng=0)
    merged = jl.merge(bits, motion=motion_of(step))
    ones, trials = sums_of(bits, step)
    assert_sums(merged, ones, trials)
    np.testing.assert_allclose(merged.acceptance, merged.trials / np.maximum(trials, 1), rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "at", "upsample"),
    [
        ("shake", 20.5, 2),
        pytest.param("shake", None, 1, marks=[pytest.mark.slow, pytest.mark.exhaustive]),
        pytest.param("fast", None, 2, marks=[pytest.mark.slow, pytest.mark.exhaustive]),
        pytest.param("layers", None, 1, marks=[pytest.mark.slow, pytest.mark.exhaustive]),
        ("sheet", None, 1),
    ],
)
def test_merging_alone_is_merging_along_what_align_returns(tmp_path, motion, at, upsample):
    """Bit for bit, also if the motion was saved."""
    _, bits = record(motion, shape=(128, 128))
    motion = jl.align(bits, at=at)
    motion.save(tmp_path / "m.safetensors")
    alone = jl.merge(bits, at=at, upsample=upsample)
    for each in (motion, jl.Motion.load(tmp_path / "m.safetensors")):
        merged = jl.merge(bits, at=at, motion=each, upsample=upsample)
        for name in ("ones", "trials", "acceptance", "posterior_error", "flags"):
            np.testing.assert_array_equal(getattr(merged, name), getattr(alone, name))


def test_merged_counts_estimate_the_image():
    """Along the true motion, counts are binomial with the probability of the image."""
    scene, bits, _ = aligned("shake")
    shifts = np.stack([scene.motion(time)[:, 0, 0] for time in range(48)])
    motion = constant_motion(shifts, (96, 96), np.arange(48), 24)
    merged = jl.merge(bits, motion=motion)
    p = scene.sensor.replace(frames=1, gain=scene.sensor.gain / 48).probability(scene.image())
    inner = (slice(20, -20), slice(20, -20))
    excess = (merged.ones - merged.trials * p)[inner]
    variance = (merged.trials * p * (1 - p))[inner]
    # Rounding to whole pixels blurs the image a little, so details deviate.
    assert (excess**2).sum() / variance.sum() == pytest.approx(1.1, abs=0.3)
    assert abs(excess.sum()) < 5 * np.sqrt(variance.sum())
    assert np.isfinite(jl.mle(merged)).all()


@pytest.mark.slow
def test_maps_of_the_sensor_are_averaged_along_the_motion():
    """The maps are linear in space, so their mean over a block is the value in its middle."""
    rows, columns = np.indices(SIZE)
    dark = 0.001 * rows + 0.0005 * columns
    efficiency = 0.6 + 0.002 * rows + 0.002 * columns
    sensor = jl.Sensor(frames=FRAMES, gain=1.0 * FRAMES, dark_counts=dark, efficiency=efficiency)
    step = 1, -2
    _, bits = moved(shifts_of(step), sensor=sensor, shape=SIZE, rng=0)
    merged = jl.merge(bits, motion=motion_of(step))
    for name, values in (("dark_counts", dark), ("efficiency", efficiency)):
        total, number = np.zeros(SIZE), np.zeros(SIZE)
        for down, right in shifts_of(step):
            for row, column in np.ndindex(*SIZE):
                y, x = row + down, column + right
                if 0 <= y < SIZE[0] and 0 <= x < SIZE[1]:
                    total[row, column] += values[y, x]
                    number[row, column] += 1
        complete = (merged.acceptance == 1) & (number == FRAMES)
        assert complete.mean() > 0.1
        expected = (total / np.maximum(number, 1))[complete]
        # The shift in the middle of a block is rounded, by half a row.
        np.testing.assert_allclose(getattr(merged, name)[complete], expected, atol=0.0011)
        assert abs(getattr(merged, name)[complete] - expected).mean() < 0.0011
    assert np.isfinite(jl.mle(merged)).all()


@pytest.mark.slow
def test_dead_jots_are_left_out_and_other_frames_fill_them():
    mask = np.random.default_rng(1).random(SIZE) < 0.1
    step = 1, -2
    sensor = jl.Sensor(frames=FRAMES, gain=1.0 * FRAMES, mask=mask)
    _, bits = moved(shifts_of(step), sensor=sensor, shape=SIZE, rng=0)
    merged = jl.merge(bits, motion=motion_of(step))
    assert_sums(merged, *sums_of(bits, step, ~mask))
    assert (merged.trials[mask] > 0).mean() > 0.95


@pytest.mark.slow
def test_jots_become_pixels():
    """Each pixel has the sums of its four jots, along the motion of jots."""
    step, jots = (0, -1), (SIZE[0], SIZE[1])
    pixels = SIZE[0] // 2, SIZE[1] // 2
    sensor = jl.Sensor(oversampling=2, frames=FRAMES)
    _, bits = moved(shifts_of(step) / 2, sensor=sensor, shape=pixels, photons=0.4, rng=0)
    merged = jl.merge(bits, motion=motion_of(step, jots))
    ones, trials = (
        values.reshape(pixels[0], 2, pixels[1], 2).sum(axis=(1, 3))
        for values in sums_of(bits, step)
    )
    assert_sums(merged, ones, trials)
    assert merged.shape == merged.posterior_error.shape == merged.flags.shape == pixels
    assert trials.max() == 4 * FRAMES
    assert np.isfinite(jl.mle(merged)).all()


def test_another_time_moves_the_sums():
    """The image at another time is the same image, shifted by the motion between both."""
    step = 1, -2
    _, bits = moved(shifts_of(step), shape=SIZE, photons=0.4, rng=0)
    motion = motion_of(step)
    middle, later = jl.merge(bits, motion=motion), jl.merge(bits, at=20, motion=motion)
    shown = middle.trials[10:50, 20:70], later.trials[14:54, 12:62]
    both = (middle.acceptance[10:50, 20:70] == 1) & (later.acceptance[14:54, 12:62] == 1)
    np.testing.assert_array_equal(shown[0][both], shown[1][both])
    shown = middle.ones[10:50, 20:70], later.ones[14:54, 12:62]
    np.testing.assert_array_equal(shown[0][both], shown[1][both])
    assert both.mean() > 0.2


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"motion": constant_motion([(0, 0), (1, 1)], (40, 64), [0, 1], 0)}, ValueError, "40 x 64"),
        ({"at": 32}, ValueError, "at: expected a time from 0 to 31"),
        ({"sensor": "sensor"}, TypeError, r"sensor: expected a jotlight\.Sensor"),
        ({"data": None}, TypeError, r"data: expected jotlight\.Bits"),
    ],
)
def test_bad_arguments_are_refused(arguments, error, message):
    _, bits = moved(shifts_of((1, -2)), shape=SIZE, photons=0.4, rng=0)
    arguments = {"data": bits, "motion": motion_of((1, -2)), **arguments}
    with pytest.raises(error, match=message):
        jl.merge(**arguments)


def test_a_motion_of_other_frames_or_jots_is_refused():
    bits = jl.Bits.from_array(np.zeros((FRAMES, *SIZE), bool))
    motion = motion_of((0, 0))
    message = r"expected that of frames 0 to 15, got that of frames 0 to 31; leave out motion= "
    with pytest.raises(ValueError, match=message):
        jl.merge(bits[:16], motion=motion)
    with pytest.raises(ValueError, match="expected that of frames 0 to 63, got"):
        jl.merge(jl.Bits.from_array(np.zeros((64, *SIZE), bool)), motion=motion)
    other = motion_of((0, 0), (64, 64))
    for sensor in (jl.Sensor(frames=FRAMES), jl.Sensor(frames=FRAMES, mosaic="RGGB")):
        with pytest.raises(ValueError, match="motion: expected that of 64 x 96 jots, got 64 x 64"):
            jl.merge(bits, sensor, motion=other)


@pytest.mark.parametrize("motion", ["affine", Path("m.safetensors"), True])
def test_a_motion_of_another_type_is_refused(motion):
    bits = jl.Bits.from_array(np.zeros((FRAMES, *SIZE), bool))
    with pytest.raises(TypeError, match=r"motion: expected a jotlight\.Motion, as jotlight\.align"):
        jl.merge(bits, motion=motion)


@pytest.mark.filterwarnings("ignore:expected 16 or more frames")
def test_a_single_frame_has_a_motion():
    bits = jl.Bits.from_array(np.ones((1, *SIZE), bool))
    assert (jl.merge(bits, motion=jl.align(bits)).trials == 1).all()
