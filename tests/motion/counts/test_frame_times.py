"""Places of frames between times."""

import numpy as np
import pytest

from jotlight.motion.counts.frame_times import places_of


@pytest.mark.parametrize("frames", [range(-3, 40), range(0, 40, 7), range(5, 5)])
def test_places_lie_on_the_lines_between_times_and_beyond(frames):
    times = (2.0, 3.5, 11.0, 30.0)
    places = places_of(frames, times)
    assert len(places) == len(frames)
    for frame, place in zip(frames, places, strict=True):
        line = min(max(int(place), 0), len(times) - 2)
        time = times[line] + (place - line) * (times[line + 1] - times[line])
        assert time == pytest.approx(frame)
        assert line == 0 or times[line] <= frame
        assert line == len(times) - 2 or frame <= times[line + 1]


def test_kept_places_cannot_be_changed():
    places = places_of(range(4), (0.0, 2.0))
    with pytest.raises(ValueError, match="read-only"):
        places[0] = 1
    np.testing.assert_array_equal(places_of(range(4), (0.0, 2.0)), [0, 0.5, 1, 1.5])
