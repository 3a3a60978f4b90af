"""The windows of a film."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.chunks import windows


def test_windows_are_whole_and_in_order():
    assert [(w.start, w.stop) for w in windows(21, 8)] == [(0, 8), (8, 16)]
    assert len(windows(21, 8, 1)) == 14
    assert len(windows(21, 1)) == 21
    for wrong in ((0, 1), (22, 1), (4, 0)):
        with pytest.raises(ValueError, match="expected 1"):
            windows(21, *wrong)


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
    with pytest.raises(TypeError, match=message.replace("window:", "n:")):
        bits.windows(*arguments)
