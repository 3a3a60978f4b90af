"""The windows of a film."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.chunks import windows
from jotlight.sensing.bits.frames import Frames


def test_windows_are_whole_and_in_order():
    assert [(w.start, w.stop) for w in windows(21, 8)] == [(0, 8), (8, 16)]
    assert len(windows(21, 8, 1)) == 14
    assert len(windows(21, 1)) == 21
    for wrong in ((0, 1), (22, 1), (4, 0)):
        with pytest.raises(ValueError, match="expected 1"):
            windows(21, *wrong)


def test_a_trillion_windows_take_no_memory():
    spans = windows(10**12, 16, 8)
    assert len(spans) == 10**12 // 8 - 1
    assert (spans[-1], spans[3]) == (slice(10**12 - 16, 10**12), slice(24, 40))
    assert list(spans[2:4]) == [slice(16, 32), slice(24, 40)]
    bits = jl.Bits(Frames((10**12, 2, 1), lambda a, b: np.full((b - a, 2, 1), 255, np.uint8)))
    assert next(bits.windows(16)).counts().max() == 16


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((2.0,), "window: expected a whole number of frames, got 2.0"),
        (("2",), "window: expected a whole number of frames, got '2'"),
        ((np.int64(2), 1.5), "step: expected a whole number of frames, got 1.5"),
        ((True,), "window: expected a whole number of frames, got True"),
        ((2, True), "step: expected a whole number of frames, got True"),
    ],
)
def test_windows_of_a_fraction_of_frames_are_refused(arguments, message):
    bits = jl.Bits.from_array(np.zeros((4, 2, 2), bool))
    with pytest.raises(TypeError, match=message):
        windows(21, *arguments)
    with pytest.raises(TypeError, match=message):
        bits.windows(*arguments)
