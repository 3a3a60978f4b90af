"""Data from which no motion can be estimated: clear messages, and the best possible results."""

import re
import warnings

import numpy as np
import pytest

import jotlight as jl
from moving import aligned, in_memory, moved, record, rms_error

RNG = np.random.default_rng(0)


def assert_usable(merged, bits):
    """Check that merged counts are finite, and that methods of several kinds accept them."""
    for name in ("ones", "trials", "dark_counts", "efficiency", "acceptance", "posterior_error"):
        assert np.isfinite(getattr(merged, name)).all(), name
    assert (merged.ones <= merged.trials).all()
    assert merged.trials.max() <= len(bits)
    with warnings.catch_warnings():
        # Dead pixels are filled, and a few iterations do not converge.
        warnings.simplefilter("ignore", jl.JotlightWarning)
        estimates = [jl.mle(merged), jl.noniterative(merged), jl.admm_tv(merged, max_iter=3)]
    for estimate in estimates:
        assert estimate.shape == merged.shape
        assert np.isfinite(estimate).all()


def assert_usable_with_any_warning(bits):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        merged = jl.merge(bits)
    assert_usable(merged, bits)


def merge(bits, message=None, **options):
    """Return merged counts, and check the warning that explains them."""
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        merged = jl.merge(bits, **options)
    assert all(issubclass(each.category, jl.JotlightWarning) for each in issued)
    messages = [str(each.message) for each in issued]
    # Sums without motion may replace the merged counts. A warning states it.
    others = [each for each in messages if "clearly better than no motion" not in each]
    if message is None:
        assert others == []
    else:
        assert len(others) == 1
        assert re.search(message, others[0])
    assert_usable(merged, bits)
    return merged


@pytest.mark.parametrize(
    "frames", [1, 3, *(pytest.param(frames, marks=pytest.mark.slow) for frames in (2, 15))]
)
def test_few_frames_stand_still(frames):
    bits = jl.Bits.from_array(RNG.random((frames, 40, 48)) < 0.3)
    message = f"expected 16 or more frames, images of counts, .*, got {frames}; the scene"
    with pytest.warns(jl.JotlightWarning, match=message):
        motion = jl.align(bits)
    assert motion.model == "none"
    assert len(motion.times) >= 2
    merged = merge(bits, message)
    assert merged.trials.max() <= frames
    if frames == 1:
        np.testing.assert_array_equal(merged.ones, bits.to_array()[0])


@pytest.mark.parametrize("value", [0, 1])
@pytest.mark.parametrize("frames", [16, 33])
def test_bits_that_are_all_equal_stand_still(value, frames):
    bits = jl.Bits.from_array(np.full((frames, 33, 40), value))
    merged = merge(bits, f"all bits are {value}, so that no motion can be estimated; the scene is")
    assert (merged.trials == frames).all()
    assert (merged.ones == frames * value).all()


@pytest.mark.slow
@pytest.mark.parametrize("density", [0.5, 0.001, 0.01])
def test_noise_stands_still(density):
    bits = jl.Bits.from_array(RNG.random((32, 48, 64)) < density)
    assert jl.align(bits).model == "none"
    merge(bits)


def test_one_photon_stands_still():
    array = np.zeros((32, 40, 50), bool)
    array[3, 4, 5] = True
    assert merge(jl.Bits.from_array(array)).ones.sum() <= 1


@pytest.mark.slow
def test_a_scene_that_leaves_the_view_is_reported():
    """The scene moves by 2.5 pixels per frame, so its points are in view for 38 frames."""
    times = np.arange(96) - 48
    scene, bits = moved(np.outer(times, (0, 2.5)), shape=(96, 96), photons=0.5, rng=0)
    with pytest.warns(jl.JotlightWarning, match=r"out of view in \d+ of 96 frames, which are not"):
        motion = jl.align(bits)
    # It is known where it is in view.
    errors = [(motion.at(time) - scene.motion(time))[:, 30:66, 30:66] for time in range(40, 57, 4)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.5
    merge(bits, motion=motion)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [8, 40])
def test_motions_that_are_too_fast_give_a_usable_result(speed):
    times = np.arange(64) - 32
    _, bits = moved(np.outer(times, (0, speed)), shape=(64, 64), photons=0.5, rng=0)
    assert_usable_with_any_warning(bits)


@pytest.mark.slow
def test_random_jumps_give_a_usable_result():
    shifts = np.random.default_rng(1).uniform(-300, 300, (64, 2))
    _, bits = moved(shifts, shape=(64, 64), photons=0.5, rng=0)
    assert_usable_with_any_warning(bits)


def masked(mask):
    scene, bits = record("shake")
    return scene, jl.Bits(np.asarray(bits.packed), bits.width, scene.sensor.replace(mask=mask))


@pytest.mark.slow
def test_half_of_the_jots_may_be_dead():
    mask = np.zeros((96, 96), bool)
    mask[:48] = True
    scene, bits = masked(mask)
    motion = jl.align(bits)
    assert motion.model == "affine"
    errors = [(motion.at(time) - scene.motion(time))[:, 56:] for time in range(0, 48, 5)]
    assert np.sqrt(np.mean(np.square(errors))) < 0.8
    merged = merge(bits, motion=motion)
    # The dead half is seen only where the scene moves into the other one.
    assert merged.trials[80:].min() > 0
    assert (merged.trials[:16] == 0).any()


@pytest.mark.slow
def test_whole_tiles_may_have_no_jots():
    mask = np.zeros((96, 96), bool)
    mask[32:64, 16:64] = True
    scene, bits = masked(mask)
    assert rms_error(jl.align(bits), scene) < 0.5
    merge(bits)


@pytest.mark.slow
def test_one_jot_may_remain():
    mask = np.ones((96, 96), bool)
    mask[40, 50] = False
    _, bits = masked(mask)
    merged = merge(bits)
    assert np.count_nonzero(merged.trials) == 1


def test_without_jots_the_methods_refuse_the_counts():
    _, bits = masked(np.ones((96, 96), bool))
    with pytest.warns(jl.JotlightWarning, match="all jots are dead or hot, so that no motion can"):
        merged = jl.merge(bits)
    assert (merged.trials == 0).all()
    with pytest.raises(ValueError, match="at least one pixel with a valid bit"):
        jl.mle(merged)


@pytest.mark.parametrize(
    "size",
    [(1, 1), (17, 33)]
    + [pytest.param(size, marks=pytest.mark.slow) for size in ((1, 40), (40, 1), (8, 8))],
)
def test_images_of_any_size_are_merged(size):
    bits = jl.Bits.from_array(RNG.random((24, *size)) < 0.3)
    assert merge(bits).shape == size
    scene = jl.datasets.moving(sensor=jl.Sensor(frames=24), shape=size, photons=0.5, rng=0)
    bits = in_memory(scene)
    assert_usable_with_any_warning(bits)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"at": 48}, ValueError, "at: expected a time from 0 to 47 in frames, got 48"),
        ({"at": -0.5}, ValueError, "at: expected a time from 0 to 47 in frames, got -0.5"),
        ({"at": np.nan}, ValueError, "at: expected a time from 0 to 47 in frames, got nan"),
        ({"at": "middle"}, ValueError, "at: expected a time .* got 'middle'"),
        ({"at": [1, 2]}, ValueError, "at: expected a time"),
        ({"model": "flow"}, ValueError, "model: expected one of auto, none, .* got 'flow'"),
        ({"model": None}, ValueError, "model: expected one of auto, none, .* got None"),
        ({"sensor": "sensor"}, TypeError, r"sensor: expected a jotlight\.Sensor, got str"),
        ({"sensor": jl.Sensor(frames=9)}, ValueError, r"9 frames, got 48; .*sensor\.replace"),
        (
            {"sensor": jl.Sensor(frames=48, mask=np.zeros((3, 3), bool))},
            ValueError,
            "mask",
        ),
        ({"threads": 0}, ValueError, "threads"),
        ({"data": np.zeros((20, 30, 40), bool)}, TypeError, r"data: expected jotlight\.Bits"),
    ],
)
def test_bad_arguments_are_refused(arguments, error, message):
    _, bits, _ = aligned("static")
    with pytest.raises(error, match=message):
        jl.align(**{"data": bits, **arguments})
