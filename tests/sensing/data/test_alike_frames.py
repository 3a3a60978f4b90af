"""The check that all frames show a scene alike, and what the message advises."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.films.live_film import LiveFilm
from jotlight.sensing.data.alike_frames import (
    check_cycles,
    exposure_cycle,
    find_cycle,
    repeat_exposures,
    require_alike_frames,
)

CHECKERBOARD = 1 + np.indices((8, 8)).sum(axis=0) % 2
GAIN = np.repeat([8.0, 1.0], [6, 10])


def test_the_advised_frames_of_a_bracket_are_taken():
    sensor = jl.Sensor(frames=16, gain=GAIN)
    bits = sensor.expose(np.full((32, 32), 0.5), rng=0)
    with pytest.raises(ValueError, match=r"such as bits\[:6\] \(--frame-range 0:6\)"):
        jl.align(bits, model="none")
    require_alike_frames(bits[:6].sensor)
    with pytest.raises(ValueError, match="got a gain for each frame"):
        require_alike_frames(bits[:7].sensor)


def test_the_first_frames_have_the_same_gain_and_threshold():
    sensor = jl.Sensor(frames=16, gain=GAIN, threshold=np.repeat([1, 2], [4, 12]))
    with pytest.raises(ValueError, match=r"a threshold for each frame; .* bits\[:4\]"):
        require_alike_frames(sensor)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bit_depth": 4}, "expected single bits without noise, got readings of 4 bits"),
        ({"read_noise": 0.3}, "without noise, got single bits with read noise 0.3"),
        ({"bit_depth": 4, "mosaic": "RGGB"}, "got readings of 4 bits"),
    ],
)
def test_no_part_of_the_frames_is_advised_where_none_is_taken(options, message):
    sensor = jl.Sensor(frames=16, **options)
    for take, ending in (
        (require_alike_frames, "take frames of one gain and threshold"),
        (
            lambda sensor: LiveFilm(sensor, window=8, step=4),
            "read noise, and exposures that repeat",
        ),
    ):
        with pytest.raises(ValueError, match=message) as caught:
            take(sensor)
        assert str(caught.value).endswith(ending)


@pytest.mark.parametrize(
    ("frames", "options", "cycle"),
    [
        (1, {}, 1),
        (7, {"bit_depth": 3}, 1),
        (7, {"gain": [1.0, 2.0] * 3 + [1.0]}, 2),
        (8, {"gain": [1.0, 2.0] * 4, "threshold": [1, 1, 3, 3] * 2}, 4),
        (6, {"gain": 3.0, "threshold": [1, 1, 2] * 2}, 3),
        (6, {"gain": np.repeat([1.0, 2.0], 3)}, None),
        (2, {"gain": [1.0, 2.0]}, None),
        (8, {"threshold": CHECKERBOARD}, 1),
        (8, {"gain": [1.0, 2.0] * 4, "threshold": CHECKERBOARD}, 2),
        (8, {"gain": np.repeat([1.0, 2.0], 4), "threshold": CHECKERBOARD}, None),
    ],
)
def test_the_cycle_of_exposures(frames, options, cycle):
    sensor = jl.Sensor(frames=frames, **options)
    assert find_cycle(sensor) == cycle
    if cycle is not None:
        assert exposure_cycle(sensor) == cycle
        longer = repeat_exposures(sensor, 2 * cycle)
        assert longer == sensor.select_frames(slice(0, cycle)).replace(
            frames=2 * cycle,
            **{
                name: np.resize(np.broadcast_to(value, frames), 2 * cycle)
                for name, value in options.items()
                if name in ("gain", "threshold") and np.ndim(value) == 1
            },
        )
    else:
        with pytest.raises(ValueError, match="expected exposures that repeat in cycles"):
            exposure_cycle(sensor)


@pytest.mark.parametrize("options", [{}, {"gain": GAIN}])
def test_no_part_of_a_map_of_thresholds_is_advised(options):
    sensor = jl.Sensor(frames=16, threshold=CHECKERBOARD, **options)
    with pytest.raises(ValueError, match=r"threshold for each jot; .* of one gain and threshold$"):
        require_alike_frames(sensor)


@pytest.mark.parametrize(("window", "step"), [(7, None), (6, 4)])
def test_windows_have_whole_cycles(window, step):
    check_cycles(3, 6, None)
    with pytest.raises(ValueError, match="expected a multiple of 3, because the exposures repeat"):
        check_cycles(3, window, step)
