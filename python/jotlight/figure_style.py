"""The style of figures."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, QUIET, MARK = "#1d2733", "#5b6876", "#e4572e"
"""Colors of titles, of secondary text, and of frames and curves."""


def set_title(axes: "Axes", title: str) -> None:
    """Set the title of axes, at their left end."""
    axes.set_title(title, fontsize=11, color=INK, loc="left")


def draw_absence(axes: "Axes", text: str) -> None:
    """Draw a text in place of data that do not exist."""
    axes.text(0.5, 0.5, text, ha="center", color=QUIET, transform=axes.transAxes)
    axes.set_axis_off()
