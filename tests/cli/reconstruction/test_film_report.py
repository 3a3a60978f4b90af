"""The report of a film."""

import types

import numpy as np
import pytest

from jotlight.cli.reconstruction.film_report import FilmSummary


def film_image(*, is_carried, acceptance):
    merged = types.SimpleNamespace(acceptance=acceptance)
    return types.SimpleNamespace(
        is_carried=is_carried,
        motion=types.SimpleNamespace(model="affine"),
        data=merged,
        merged=merged,
    )


def test_the_values_of_all_images_are_summarized():
    summary = FilmSummary(has_memory=False)
    for level in (2.0, 0.5, 1.0):
        summary.add(np.linspace(0, level, 12, dtype=np.float32).reshape(3, 4) + 0.25)
    assert (summary.images, summary.shape) == (3, (3, 4))
    assert (summary.minimum, summary.maximum) == (0.25, 2.25)
    assert summary.brightness == pytest.approx(2.25, rel=0.01)
    assert summary.motion_lines(None) == []


def test_carried_motions_and_used_bits_are_summarized():
    summary = FilmSummary(has_memory=True)
    assert not summary.uses_memory
    for index, fraction in enumerate((0.9, 0.7, 0.8)):
        summary.add_motion(film_image(is_carried=index > 0, acceptance=np.full((2, 2), fraction)))
        summary.add(np.zeros((2, 2), np.float32))
    assert summary.uses_memory
    line = (
        "motion: affine; estimated anew for 1 image, and carried to 2 others; 80.0% of the bits "
        "agree and are used, and 70.0% or more of each image"
    )
    assert summary.motion_lines(None) == [line]
    first, second = summary.motion_lines("differences")
    assert first == line
    assert second.startswith("demosaicing: not used for 3 merged images")
