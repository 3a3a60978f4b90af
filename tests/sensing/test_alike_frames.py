"""The check that all frames show a scene alike, and what the message advises."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.live_film import LiveFilm
from jotlight.sensing.alike_frames import require_alike_frames

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
        ({"threshold": CHECKERBOARD}, "got a threshold for each jot"),
        ({"bit_depth": 4}, "expected single bits without noise, got readings of 4 bits"),
        ({"read_noise": 0.3}, "without noise, got single bits with read noise 0.3"),
        ({"bit_depth": 4, "mosaic": "RGGB"}, "got readings of 4 bits"),
    ],
)
def test_no_part_of_the_frames_is_advised_where_none_is_taken(options, message):
    sensor = jl.Sensor(frames=16, **options)
    for take in (require_alike_frames, lambda sensor: LiveFilm(sensor, window=8, step=4)):
        with pytest.raises(ValueError, match=message) as caught:
            take(sensor)
        assert str(caught.value).endswith("take frames of one gain and threshold")
