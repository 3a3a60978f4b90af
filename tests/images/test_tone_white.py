"""The white of images for display that state none."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.images.tone import Tone, display_tone, find_white

DIM = np.linspace(0, 0.05, 400, dtype=np.float32).reshape(20, 20)


def test_the_warning_about_white_names_the_image():
    with pytest.warns(jl.JotlightWarning, match=r"^night: 0\.0498, the 99\.5th percentile, is"):
        assert find_white(DIM, "night") == pytest.approx(np.percentile(DIM, 99.5))


def test_a_stated_white_is_used_as_it_is():
    assert display_tone(DIM, None, 3.0) == Tone("linear", 3.0)
    assert display_tone(DIM, "log", 3.0).white == 3.0


def test_a_curve_without_white_has_the_percentile_and_no_warning():
    assert display_tone(DIM, "gamma", None) == Tone.fit(DIM, "gamma")
