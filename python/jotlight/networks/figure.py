"""Drawings of the layers of a network: their splines and their filters."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jotlight.errors import plural
from jotlight.figure_style import set_title
from jotlight.networks.layer import Layer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from jotlight.figures import Figure

_MAX_CURVES = 12
"""Maximum number of splines or filters drawn per layer."""


def figure_of_layers(layers: Sequence[Layer]) -> "Figure":
    """Return a figure of some splines and filters of a network."""
    from jotlight.figures import Figure

    figure = Figure(11, 3.2)
    draw_layers(figure.subplots(1, 3), layers)
    return figure


def draw_layers(all_axes: "Sequence[Axes]", layers: Sequence[Layer]) -> None:
    """Draw the first trained splines, the filters of the first trained layer, and the last splines.

    Parameters
    ----------
    all_axes : three matplotlib.axes.Axes
        Where to draw.
    layers : sequence of Layer
        The layers of a network.
    """
    with_splines = [index for index, layer in enumerate(layers) if layer.coefficients is not None]
    trained = [index for index in with_splines if layers[index].trainable == "all"] or with_splines
    for axes, indices in ((all_axes[0], trained[:1]), (all_axes[2], trained[-1:])):
        for index in indices:
            _draw_splines(axes, index, layers[index])
        if not indices:
            axes.set_axis_off()
    # The first layer weighs bits, so its filters are less interesting.
    later = [index for index in range(1, len(layers)) if layers[index].trainable != "nothing"]
    index = later[0] if later else 0
    _draw_filters(all_axes[1], index, layers[index])


def _draw_splines(axes: "Axes", number: int, layer: Layer) -> None:
    """Draw the first splines of a layer. If it has several parameter sets, draw the middle one."""
    from scipy.interpolate import BSpline

    assert layer.coefficients is not None, "a layer with splines"
    splines = layer.coefficients
    if splines.ndim == 3:
        splines = splines[len(splines) // 2]
    size = splines.shape[1]
    knots = layer.start + layer.spacing * (np.arange(size + 4) - 3)
    z = np.linspace(knots[3], knots[-4], 500)
    for coefficients in splines[:_MAX_CURVES]:
        axes.plot(z, BSpline(knots, coefficients.astype(np.float64), 3)(z), linewidth=1.5)
    axes.grid(alpha=0.3)
    set_title(axes, f"φ of layer {number}{_limit_note(len(splines))}")


def _draw_filters(axes: "Axes", number: int, layer: Layer) -> None:
    """Draw the first filters of a layer side by side, for the first input channel only.

    If it has several parameter sets, draw the middle one.
    """
    of_k = layer.filters if layer.filters.ndim == 4 else layer.filters[len(layer.filters) // 2]
    filters = of_k[:, 0]
    shown = filters[:_MAX_CURVES]
    columns = math.ceil(math.sqrt(len(shown)))
    rows = math.ceil(len(shown) / columns)
    height, width = filters.shape[1:]
    # One empty pixel separates two filters.
    sheet = np.full((rows * (height + 1) - 1, columns * (width + 1) - 1), np.nan)
    for index, taps in enumerate(shown):
        top, left = (index // columns) * (height + 1), (index % columns) * (width + 1)
        sheet[top : top + height, left : left + width] = taps
    largest = float(np.abs(shown).max()) or 1.0
    image = axes.imshow(sheet, cmap="RdBu_r", vmin=-largest, vmax=largest)
    axes.set_axis_off()
    noun = plural(len(filters), "filter")
    set_title(axes, f"{noun} of layer {number}{_limit_note(len(filters))}")
    axes.figure.colorbar(image, ax=axes, shrink=0.9)


def _limit_note(number: int) -> str:
    """Return the end of a title that says how many of `number` splines or filters are drawn."""
    return f", {_MAX_CURVES} of {number}" if number > _MAX_CURVES else ""
