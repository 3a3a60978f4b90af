"""Arguments of the engine's estimators that state different numbers of images are errors."""

import numpy as np
import pytest

import jotlight._engine as engine

RESPONSE = 1, 1.0, 1.0
IDEAL = 1.0, 0.0


@pytest.mark.parametrize("number", [1, 3, 6])
def test_each_image_of_an_update_has_its_penalty(number):
    light, x, dual = np.full((3, 2, 3), 0.5)
    readings = 1, np.full(6, 3, np.int32), 5.0, *IDEAL
    with pytest.raises(ValueError, match=f"penalties: expected length 2, got {number}"):
        engine.likelihood_admm_update(readings, (np.ones(number), 1.5), 4.0, light, x, dual, None)


@pytest.mark.parametrize("number", [1, 4])
def test_each_image_of_equivalent_counts_has_its_reference_trials(number):
    counts, out = np.full((2, 2), 4, np.int32), np.zeros((2, 2), np.float32)
    with pytest.raises(ValueError, match=f"reference trials: expected length 2, got {number}"):
        engine.equivalent_counts(RESPONSE, counts, 8.0, IDEAL, np.ones(number), IDEAL, out, None)


@pytest.mark.parametrize(
    ("jots", "width", "message"),
    [
        ((3, 4), 3, "rows of pixels: expected length 4, got 3"),
        ((3, 4), 0, "rows of pixels: expected length 4, got 0"),
        ((4, 3), 2, "ones: expected length 3, got 4"),
    ],
)
def test_images_of_estimates_from_jots_have_whole_rows(jots, width, message):
    ones, out = np.zeros(jots, np.int32), np.zeros((3, 4), np.float32)
    with pytest.raises(ValueError, match=message):
        engine.mle_from_jots(RESPONSE, ones, IDEAL, None, 5, 1, width, out, None)
