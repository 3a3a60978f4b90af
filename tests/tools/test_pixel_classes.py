"""The classes of the pixels of a photograph: flat, edge, and texture."""

import importlib
from pathlib import Path

import numpy as np
import pytest

TOOLS = Path(__file__).parents[2] / "tools"


@pytest.fixture
def classify(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("pixel_classes").classify


def test_a_constant_image_is_flat(classify):
    np.testing.assert_array_equal(classify(np.full((20, 30), 0.4)), 0)


def test_the_border_of_two_halves_is_an_edge(classify):
    image = np.full((40, 60), 0.2)
    image[:, 30:] = 0.8
    classes = classify(image)
    np.testing.assert_array_equal(classes[:, 29:31], 1)
    np.testing.assert_array_equal(classes[:, :20], 0)


def test_slopes_of_all_directions_are_texture(classify):
    image = np.random.default_rng(0).uniform(0.2, 0.8, (80, 80))
    assert (classify(image) == 2).mean() > 0.8
