"""HTML for notebooks."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from jotlight.notebook import average_to_side, card, enlarge


def test_texts_cannot_act_as_html_and_are_cut():
    text = card("<i>", {"<script>": "<img src=x onerror=alert(1)>", "long": 10_000 * "a"})
    assert "<script>" not in text
    assert "<img" not in text
    assert "&lt;img src=x onerror=alert(1)&gt;" in text
    assert len(text) < 600


@pytest.mark.parametrize("shape", [(5, 9), (5, 9, 3), (400, 1000), (1, 2000), (300, 200, 3)])
def test_an_image_is_a_small_png(shape):
    image = np.random.default_rng(0).random(shape)
    text = card("title", {}, image)
    data = re.search('base64,([^"]+)', text)
    assert data is not None
    decoded = np.asarray(Image.open(io.BytesIO(base64.b64decode(data[1])))) / 255
    assert max(decoded.shape[:2]) <= 192
    np.testing.assert_allclose(decoded, enlarge(average_to_side(image)), atol=0.002)


@pytest.mark.parametrize(
    ("shape", "size"),
    [
        ((3, 3), (192, 192)),
        ((1, 1), (192, 192)),
        ((2048, 1), (187, 8)),
        ((50, 60, 3), (150, 180, 3)),
        ((97, 97), (97, 97)),
    ],
)
def test_small_and_thin_images_are_shown_in_a_size_that_people_see(shape, size):
    image = np.random.default_rng(2).random(shape)
    shown = enlarge(average_to_side(image))
    assert shown.shape == size
    assert set(np.unique(shown)) == set(np.unique(average_to_side(image)))


def test_an_image_has_a_caption_for_those_who_do_not_see_it():
    assert '<img alt="&lt;i&gt;: image" ' in card("<i>", {}, np.zeros((2, 2)))


@pytest.mark.parametrize("shape", [(7, 10), (6, 9), (1, 100), (9, 10, 3)])
def test_shrinking_averages_squares_also_incomplete_ones(shape):
    image = np.random.default_rng(1).random(shape)
    side = 4
    factor = -(-max(shape[:2]) // side)
    found = average_to_side(image, side)
    for row in range(found.shape[0]):
        for column in range(found.shape[1]):
            square = image[row * factor :, column * factor :][:factor, :factor]
            np.testing.assert_allclose(found[row, column], square.mean(axis=(0, 1)))
    assert average_to_side(image, 100) is image
