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
