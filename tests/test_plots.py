import numpy as np
import pytest

import jotlight as jl
from jotlight import plots


def test_the_crop_lies_on_the_edges_and_inside_the_image():
    image = np.zeros((60, 80))
    image[40:50, 10:20] = 1
    top, left, tall, wide = plots.find_detail(image)
    assert (tall, wide) == (12, 20)
    assert top <= 45 <= top + tall
    assert left <= 15 <= left + wide


@pytest.mark.parametrize("shape", [(1, 1), (2, 7), (40, 3), (5, 5, 3)])
def test_the_crop_of_a_tiny_image_lies_inside(shape):
    top, left, tall, wide = plots.find_detail(np.random.default_rng(0).random(shape))
    assert top >= 0
    assert top + tall <= shape[0]
    assert left >= 0
    assert left + wide <= shape[1]


@pytest.mark.parametrize("number", [1, 2, 4, 5, 9])
def test_every_panel_has_an_image_and_a_crop_that_do_not_overlap(number):
    panels = [plots.Panel(f"title {i}", "below", np.full((30, 40), 0.5)) for i in range(number)]
    figure = plots.comparison(panels, "heading")
    boxes = [axes.get_position() for axes in figure.axes]
    assert len(boxes) == 2 * number
    for i, one in enumerate(boxes):
        assert one.x0 >= 0
        assert one.y0 >= 0
        assert one.x1 <= 1
        assert one.y1 <= 1
        for other in boxes[:i]:
            apart = one.x0 >= other.x1 or one.x1 <= other.x0 or one.y0 >= other.y1
            assert apart or one.y1 <= other.y0
    titles = {text.get_text() for text in figure.texts}
    assert {panel.title for panel in panels} < titles


def test_the_bits_panel_shows_single_jots():
    sensor = jl.Sensor(oversampling=3)
    bits = sensor.expose(np.full((4, 5), 0.7), rng=0)
    panel = plots.bits_panel(bits, 3)
    jots = bits.to_array()[0]
    assert (panel.detail == jots).all()
    assert (panel.image == jots[::3, ::3]).all()
    assert f"{jots.mean():.0%}" in panel.subtitle


@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        (np.full((9, 8), 200, np.uint8), TypeError, "image: expected floats .*divide by its white"),
        (np.eye(9, dtype=bool), TypeError, r"image: expected floats .*image\.astype\(float\)"),
        (np.full((9, 8), np.nan), ValueError, "image: expected finite values"),
        (
            np.ones((5, 9, 8)),
            ValueError,
            r"expected shape \(H, W\) or \(H, W, 3\), got \(5, 9, 8\)",
        ),
        (np.ones((9, 8, 2)), ValueError, "expected shape"),
        (np.ones(9), ValueError, "expected shape"),
        (np.ma.ones((9, 8)), TypeError, "image: .* got a masked one"),
    ],
)
def test_what_is_no_image_of_intensities_is_no_panel(image, error, message):
    """An image of 0 to 255 would be white."""
    with pytest.raises(error, match=message):
        plots.Panel("title", "", image)
    with pytest.raises(error, match=message.replace("image:", "detail:")):
        plots.Panel("title", "", np.ones((9, 8)), image)


def test_lists_and_single_channels_are_images():
    assert plots.Panel("title", "", [[0.0, 1.0]]).image.shape == (1, 2)
    figure = plots.comparison([plots.Panel("title", "", np.ones((20, 30, 1)))], "heading")
    assert len(figure.axes) == 2


@pytest.mark.parametrize(
    ("panels", "error", "message"),
    [
        ([], ValueError, "one or more images of one size, got none"),
        ({"a": np.ones((9, 8))}, TypeError, r"expected a list of panels, such as \[jotlight"),
        ([np.ones((9, 8))], TypeError, "expected a list of panels"),
        (
            [plots.Panel("a", "", np.ones(size)) for size in ((9, 8), (9, 7), (9, 8))],
            ValueError,
            r"of one size, got \(9, 7\) and \(9, 8\)",
        ),
    ],
)
def test_other_panels_are_refused(panels, error, message):
    with pytest.raises(error, match=message):
        plots.comparison(panels, "heading")
    with pytest.raises(ValueError, match="white: expected a finite number above 0, got 0"):
        plots.comparison([plots.Panel("a", "", np.ones((9, 8)))], "heading", white=0)
