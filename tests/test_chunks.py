"""The windows of a film."""

import pytest

from jotlight.chunks import windows


def test_windows_are_whole_and_in_order():
    assert [(w.start, w.stop) for w in windows(21, 8)] == [(0, 8), (8, 16)]
    assert len(windows(21, 8, 1)) == 14
    assert len(windows(21, 1)) == 21
    for wrong in ((0, 1), (22, 1), (4, 0)):
        with pytest.raises(ValueError, match="expected 1"):
            windows(21, *wrong)
