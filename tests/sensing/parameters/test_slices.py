"""Slices: what they select, and their messages."""

import numpy as np
import pytest

from jotlight.sensing.parameters.slices import chosen_range, format_frame_range, refuse_no_frames


@pytest.mark.parametrize("part", [np.s_[2:5], np.s_[-3:], np.s_[::-2], np.s_[np.int64(1) : True]])
def test_a_slice_selects_as_it_does_from_a_list(part):
    assert list(chosen_range("bits", "rows", part, 9)) == list(range(9))[part]


def test_the_text_of_a_slice_is_that_of_an_index():
    assert [format_frame_range(each) for each in np.s_[2:5, -3:, ::-2]] == ["2:5", "-3:", "::-2"]


@pytest.mark.parametrize(
    ("part", "error", "message"),
    [
        (np.s_[1.5:4:2], TypeError, "^counts: expected whole numbers .* frames, .* got 1.5:4:2$"),
        (np.s_[::0], ValueError, "^counts: expected a slice of frames with a step other than 0"),
        (np.s_[9:], ValueError, "^counts: no frames in 9: of 9$"),
    ],
)
def test_slices_of_no_frames_are_refused(part, error, message):
    with pytest.raises(error, match=message):
        refuse_no_frames("counts", part, 9)
