"""A figure of a motion."""

from typing import TYPE_CHECKING

import numpy as np

from jotlight.motion.motion import Motion
from jotlight.motion.tiles import TILE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIDE = 4.2
"""Width of a panel in inches."""

_ARROWS = 12
"""Maximum number of arrows along each axis."""


def draw_motion(motion: Motion) -> "Figure":
    """Return a figure of the displacements over time, and of where the scene moves how.

    Examples
    --------
    >>> nodes = np.zeros((1, 2, 2, 4, 4), np.float32)
    >>> information = np.ones((1, 2, 3, 4, 4), np.float32)
    >>> labels = np.zeros((64, 64), np.uint8)
    >>> motion = Motion(nodes, labels, np.array([0.0, 6.0]), 0.0, "none", information)
    >>> len(draw_motion(motion).axes)
    2
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2 * _SIDE, _SIDE), layout="constrained")
    paths, field = figure.subplots(1, 2)
    used = np.flatnonzero(np.bincount(motion.labels.ravel(), minlength=len(motion.nodes)))
    for position, index in enumerate(used):
        mean = motion.nodes[index].mean(axis=(2, 3))
        name = f", part {position + 1}" if len(used) > 1 else ""
        paths.plot(motion.times, mean[:, 0], "-", color=f"C{position}", label=f"rows{name}")
        paths.plot(motion.times, mean[:, 1], "--", color=f"C{position}", label=f"columns{name}")
    paths.axvline(motion.reference, color="0.7", linewidth=1)
    paths.set(title="mean displacement", xlabel="time in frames", ylabel="pixels")
    paths.legend(fontsize=8)
    _draw_field(field, motion)
    return figure


def _draw_field(axes: "Axes", motion: Motion) -> None:
    """Draw the change of the displacements from the first to the last time."""
    height, width = motion.size
    change = motion.at(motion.times[-1]) - motion.at(motion.times[0])
    step = max(TILE, -(-max(height, width) // _ARROWS))
    rows, columns = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    axes.imshow(motion.labels, cmap="Pastel1", interpolation="nearest")
    axes.quiver(
        columns,
        rows,
        change[1, rows, columns],
        change[0, rows, columns],
        angles="xy",
        width=0.004,
    )
    axes.set(title=f"motion from the first to the last time ({motion.model})", xticks=[], yticks=[])
