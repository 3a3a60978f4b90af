"""Drawings of a motion."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Array32, Labels
from jotlight.motion.tiles import TILE

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_ARROWS = 12
"""Maximum number of arrows along each axis."""


def draw_paths(
    axes: "Axes", times: Array, nodes: Array32, labels: Labels, reference: float
) -> None:
    """Draw the mean displacement of each field that jots follow, over time.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    times, nodes, labels, reference
        Those of a :class:`jotlight.Motion`.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> axes = Figure().subplots()
    >>> nodes = np.zeros((1, 2, 2, 4, 4), np.float32)
    >>> draw_paths(axes, np.array([0.0, 6.0]), nodes, np.zeros((64, 64), np.uint8), 3.0)
    >>> [line.get_label() for line in axes.lines[:2]]
    ['rows', 'columns']
    """
    used = np.flatnonzero(np.bincount(labels.ravel(), minlength=len(nodes)))
    for position, index in enumerate(used):
        mean = nodes[index].mean(axis=(2, 3))
        name = f", part {position + 1}" if len(used) > 1 else ""
        axes.plot(times, mean[:, 0], "-", color=f"C{position}", label=f"rows{name}")
        axes.plot(times, mean[:, 1], "--", color=f"C{position}", label=f"columns{name}")
    axes.axvline(reference, color="0.7", linewidth=1)
    axes.set(title="mean displacement", xlabel="time in frames", ylabel="jots")
    axes.legend(fontsize=8)


def draw_change(axes: "Axes", labels: Labels, change: npt.NDArray[np.float32], title: str) -> None:
    """Draw a change of the displacements, (2, H, W), as arrows over the labels of the jots.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> axes = Figure().subplots()
    >>> draw_change(axes, np.zeros((64, 64), np.uint8), np.ones((2, 64, 64), np.float32), "a title")
    >>> axes.get_title()
    'a title'
    """
    height, width = labels.shape
    step = max(TILE, -(-max(height, width) // _ARROWS))
    rows, columns = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    axes.imshow(labels, cmap="Pastel1", interpolation="nearest")
    arrows = change[:, rows, columns]
    scale = None if arrows.any() else 1.0  # matplotlib cannot scale arrows without a length
    axes.quiver(columns, rows, arrows[1], arrows[0], angles="xy", width=0.004, scale=scale)
    axes.set(title=title, xticks=[], yticks=[])
