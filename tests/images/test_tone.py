"""Tone curves map images of any range to a display."""

import numpy as np
import pytest

from jotlight.images.tone import CURVES, Tone


@pytest.mark.parametrize("curve", CURVES)
def test_every_curve_rises_from_black_to_white_and_clips_only_above(curve):
    tone = Tone(curve, white=40.0, middle=0.05)
    shown = tone(np.linspace(0, 40, 500))
    assert shown[0] == 0
    assert shown[-1] == pytest.approx(1, abs=1e-6)
    assert (np.diff(shown) > 0).all()
    assert tone(np.array([1e9]))[0] == pytest.approx(1, abs=1e-6)


def test_the_curves_have_their_formulas():
    x = np.array([0.01, 0.3, 1.0])
    np.testing.assert_allclose(Tone("linear", 2.0)(2 * x), x, rtol=1e-6)
    np.testing.assert_allclose(Tone("gamma", 2.0)(2 * x), x ** (1 / 2.2), rtol=1e-6)
    np.testing.assert_allclose(Tone("log")(x), np.log(1 + 1000 * x) / np.log(1001), rtol=1e-6)
    y, w = 0.18 * x / 0.05, 0.18 / 0.05
    np.testing.assert_allclose(
        Tone("reinhard", middle=0.05)(x), (y * (1 + y / w**2) / (1 + y)) ** (1 / 2.2), rtol=1e-6
    )


@pytest.mark.parametrize("curve", ["gamma", "log", "reinhard"])
def test_dark_parts_of_a_wide_range_become_visible(curve):
    image = np.geomspace(1e-3, 10, 1000)
    shown = Tone.fit(image, curve)(image)
    assert np.median(shown) > 2 * np.median(Tone.fit(image, "linear")(image))


def test_white_is_a_percentile_and_black_images_stay_black():
    image = np.append(np.ones(999), 1e6)
    assert Tone.fit(image, "linear").white == 1
    assert Tone.fit(np.zeros((3, 3)))(np.zeros((3, 3))).max() == 0
    # A single light in the dark.
    assert Tone.fit(np.append(np.zeros(999), 7.0)).white == 7


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Tone("sepia"), "linear, gamma, log, reinhard, got 'sepia'"),
        (lambda: Tone("gamma", white=0.0), "above 0"),
        (lambda: Tone.fit(np.ones(3), percentile=0), "percentile"),
    ],
)
def test_bad_arguments_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
