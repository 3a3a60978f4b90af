"""Drawings of a training run: its curves."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.figure_style import MARK, QUIET, draw_absence, set_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_curves(
    all_axes: "Sequence[Axes]",
    steps: npt.NDArray[np.int64],
    loss: Array,
    gradient_norm: Array,
    test_psnr: Array,
    held_out: Array,
) -> None:
    """Draw the cost, the norm of its gradient, and the quality on tests or on held-out bits.

    Parameters
    ----------
    all_axes : three matplotlib.axes.Axes
        Where to draw.
    steps, loss, gradient_norm, test_psnr, held_out
        Those of a history.
    """
    tests, unit = ("test PSNR, dB", test_psnr), ""
    if np.isfinite(held_out).any():
        tests, unit = ("held out, nats per bit", held_out), ", nats per bit"
    measured = np.isfinite(tests[1])
    _draw_curve(all_axes[0], f"cost ε{unit}", steps, loss, "log")
    _draw_curve(all_axes[1], "gradient norm ‖∇ε‖", steps, gradient_norm, "log")
    _draw_curve(all_axes[2], tests[0], steps[measured], tests[1][measured], "linear")


def _draw_curve(axes: "Axes", title: str, x: npt.NDArray[np.int64], y: Array, scale: str) -> None:
    set_title(axes, title)
    axes.set_xlabel("step", color=QUIET)
    if len(x) == 0:
        draw_absence(axes, "not measured")
        return
    axes.set_yscale(scale)
    # Each step uses different patches, so the curve is noisy. The moving average over a hundredth
    # of the run shows the trend.
    span = max(1, len(y) // 100)
    mean = np.convolve(y, np.full(span, 1 / span), "valid")
    marker = "o" if len(y) == 1 else ""
    axes.plot(x, y, color=MARK, linewidth=1, marker=marker, alpha=1 if span == 1 else 0.3)
    axes.plot(x[span // 2 :][: len(mean)], mean, color=MARK, linewidth=1)
