"""The pixels of a film that are brighter than its white."""

import warnings

import numpy as np
import pytest

from jotlight.images.clipping import Clipping


def messages(clipping):
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        clipping.report()
    return [str(warning.message) for warning in warned]


@pytest.mark.parametrize("expected", [None, 0.25])
def test_only_images_with_more_bright_pixels_than_expected_are_reported(expected):
    clipping = Clipping(1.0, expected)
    for bright in (0, 2, 4, 8):
        image = np.full((2, 4, 3), 0.5, np.float32)
        image.reshape(8, 3)[:bright, 1] = 2 + bright  # one bright channel suffices
        clipping.count(image)
    [message] = messages(clipping)
    number, first, share = (3, 1, "58.3") if expected is None else (2, 2, "75")
    assert message.startswith(
        f"images: {share} % of the pixels of {number} images, the first of them image {first}, "
        "are brighter than white, 1; white=10 (--white 10) shows the largest value"
    )


def test_nothing_is_reported_without_brighter_pixels():
    clipping = Clipping(2.0)
    clipping.count(np.full((2, 4), 2.0, np.float32))
    assert messages(clipping) == []
