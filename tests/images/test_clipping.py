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


@pytest.mark.parametrize("is_percentile", [False, True])
def test_only_images_with_more_bright_pixels_than_expected_are_reported(is_percentile):
    """Images with 1.6 and 2.7 % are ordinary: their noise differs from that of the samples."""
    clipping = Clipping(1.0, is_percentile)
    for bright in (0, 16, 27, 51, 70, 700):
        image = np.full((20, 50, 3), 0.5, np.float32)
        image.reshape(1000, 3)[:bright, 1] = 10 if bright == 700 else 2  # one channel suffices
        clipping.count(image)
    [message] = messages(clipping)
    number, first, share = (2, 4, "38.5") if is_percentile else (5, 1, "17.3")
    assert message.startswith(
        f"images: {share} % of the pixels of {number} images, the first of them image {first}, "
        "are brighter than white, 1; white=10 (--white 10) shows the largest value"
    )


def test_nothing_is_reported_without_brighter_pixels():
    clipping = Clipping(2.0)
    clipping.count(np.full((2, 4), 2.0, np.float32))
    assert messages(clipping) == []
