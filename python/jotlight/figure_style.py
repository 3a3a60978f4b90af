"""The style of figures."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

INK, QUIET, MARK = "#1d2733", "#5b6876", "#e4572e"
"""Colors of titles, of secondary text, and of frames and curves."""


def set_title(axes: "Axes", title: str) -> None:
    """Set the title of axes, at their left end."""
    axes.set_title(title, fontsize=11, color=INK, loc="left")


def add_color_bar(axes: "Axes", shown: "AxesImage", **options: Any) -> None:
    """Add a color bar to an image (H, W), which says that values lie outside of its range.

    An end beyond which there are values is pointed, and the label states the lowest or the highest
    of them.
    """
    values: npt.NDArray[np.floating] = np.ma.masked_invalid(
        np.ma.asanyarray(shown.get_array())
    ).compressed()
    low, high = shown.get_clim()
    outside = []
    if values.size and values.min() < low:
        outside.append(("min", f"down to {values.min():.3g}"))
    if values.size and values.max() > high:
        outside.append(("max", f"up to {values.max():.3g}"))
    extend = "both" if len(outside) == 2 else outside[0][0] if outside else "neither"
    bar = axes.figure.colorbar(shown, ax=axes, extend=extend, **options)
    bar.set_label(", ".join(text for _, text in outside), color=QUIET, fontsize=8)


def draw_absence(axes: "Axes", text: str) -> None:
    """Draw a text in place of data that do not exist."""
    axes.text(0.5, 0.5, text, ha="center", color=QUIET, transform=axes.transAxes)
    axes.set_axis_off()
