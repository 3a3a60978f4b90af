"""Figures of motions: they show the displacements."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from jotlight.images.io import read_image
from jotlight.motion.figure import draw_change, draw_paths
from moving import constant_motion


@pytest.mark.slow
def test_a_figure_shows_paths_and_arrows(tmp_path):
    motion = constant_motion([(0, 0), (2, -4), (6, 3)], (64, 96), [0, 4, 8], 4)
    figure = motion.plot()
    paths, field = figure.axes
    rows, columns, reference = paths.lines
    np.testing.assert_array_equal(rows.get_ydata(), [0, 2, 6])
    np.testing.assert_array_equal(columns.get_ydata(), [0, -4, 3])
    np.testing.assert_array_equal(rows.get_xdata(), [0, 4, 8])
    assert set(reference.get_xdata()) == {4}
    (arrows,) = (each for each in field.collections if hasattr(each, "U"))
    np.testing.assert_allclose(arrows.V, 6)
    np.testing.assert_allclose(arrows.U, 3)
    assert "affine" in field.get_title()
    figure.savefig(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png").std() > 0.05


def test_fields_that_no_pixel_follows_are_not_drawn():
    axes = Figure().subplots()
    nodes = np.arange(3 * 2 * 2, dtype=np.float32).reshape(3, 2, 2, 1, 1)
    labels = np.array([[0, 2]], np.uint8)
    draw_paths(axes, np.array([0.0, 1]), nodes, labels, 0.0)
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ["rows, part 1", "columns, part 1", "rows, part 2", "columns, part 2"]
    np.testing.assert_array_equal(axes.lines[2].get_ydata(), nodes[2, :, 0, 0, 0])


def test_large_images_have_few_arrows_and_small_ones_have_one():
    for size, number in (((1000, 600), 12 * 8), ((5, 7), 0), ((16, 16), 1)):
        axes = Figure().subplots()
        change = np.ones((2, *size), np.float32)
        draw_change(axes, np.zeros(size, np.uint8), change, "change")
        (arrows,) = (each for each in axes.collections if hasattr(each, "U"))
        assert abs(arrows.N - number) <= 12
