"""Curves as SVG, in colors that a page can change for its dark theme."""

import dataclasses
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes as MatplotlibAxes

TEXT_COLOR, MUTED_COLOR = "#1d2733", "#5b6876"
"""The colors of text and of axes. The HTML page replaces them with those of its theme."""

BACKGROUND_ID = "patch_1"
"""The id of the background, which is Matplotlib's name for the first area of a figure."""

METHOD_COLORS = {
    "mle": "#8a8f98",
    "noniterative-gaussian": "#3f9fdc",
    "noniterative-tv": "#2f6fb7",
    "noniterative-nlm": "#b865a3",
    "noniterative-bm3d": "#0f9d74",
    "noniterative-bm3d-algebraic": "#5bb898",
    "admm-tv": "#c98a00",
    "network-initial": "#a58c6f",
    "network-two-layer": "#d55e00",
    "network-small": "#e0559a",
    "network-medium": "#c0392b",
    "network-large": "#7b2d8b",
    "network-extra-large": "#3d1a6e",
}
"""The color of each method, the same in every figure."""

OTHER_COLOR = "#4b5563"
"""The color of methods without a color of their own."""

_MAX_LABELS_INSIDE = 3
"""The largest number of labels for which the legend fits among the curves."""


@dataclasses.dataclass(frozen=True)
class Line:
    """A curve."""

    label: str
    x: npt.ArrayLike
    y: npt.ArrayLike
    color: str
    marker: str = ""
    style: str = "-"
    """The style of the line, as Matplotlib names it: "-", "--", "-.", ":"."""
    width: float = 1.6


@dataclasses.dataclass(frozen=True)
class Axes:
    """Curves in one coordinate system."""

    lines: Sequence[Line]
    x_label: str
    y_label: str
    title: str = ""
    x_log: bool = False
    y_log: bool = False
    x_ticks: Sequence[float] | None = None


def render_svg(axes: Sequence[Axes]) -> str:
    """Return an SVG of coordinate systems side by side. The same curves make the same SVG.

    Its background is white, because its dark texts are unreadable on that of a dark page.

    Examples
    --------
    >>> render_svg([Axes([Line("a", [0, 1], [0, 1], color="#d55e00")], "x", "y")])[:5]
    '<?xml'
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    style: Any = {
        # Text stays text, so a page sets it in its own font and readers can search it.
        "svg.fonttype": "none",
        "svg.hashsalt": "jotlight",
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],
        "text.color": TEXT_COLOR,
        "axes.labelcolor": TEXT_COLOR,
        "axes.edgecolor": MUTED_COLOR,
        "xtick.color": MUTED_COLOR,
        "ytick.color": MUTED_COLOR,
        "axes.spines.top": False,
        "axes.spines.right": False,
    }
    with rc_context(style):
        figure = Figure(figsize=(max(7.4, 4.6 * len(axes)), 3.8), layout="constrained")
        figure.patch.set_facecolor("white")
        drawn = figure.subplots(1, len(axes), squeeze=False)[0]
        for target, content in zip(drawn, axes, strict=True):
            _plot(target, content)
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def _plot(target: "MatplotlibAxes", axes: Axes) -> None:
    target.patch.set_alpha(0)
    for line in axes.lines:
        target.plot(
            line.x,
            line.y,
            label=line.label or None,
            color=line.color,
            marker=line.marker or None,
            markersize=7 if np.size(line.x) == 1 else 4,
            linestyle=line.style,
            linewidth=line.width,
        )
    target.set_xlabel(axes.x_label)
    target.set_ylabel(axes.y_label)
    if axes.title:
        target.set_title(axes.title, fontsize=11, loc="left", color=TEXT_COLOR)
    if axes.x_log:
        target.set_xscale("log")
    if axes.y_log:
        target.set_yscale("log")
    if axes.x_ticks is not None:
        target.set_xticks(axes.x_ticks, [f"{tick:g}" for tick in axes.x_ticks])
        target.minorticks_off()
    target.grid(visible=True, color=MUTED_COLOR, alpha=0.25, linewidth=0.6)
    _add_legend(target, [line for line in axes.lines if line.label])


def _add_legend(target: "MatplotlibAxes", labeled: Sequence[Line]) -> None:
    if 1 < len(labeled) <= _MAX_LABELS_INSIDE:
        legend = target.legend(fontsize=8, frameon=False, labelcolor=TEXT_COLOR)
        for handle in legend.get_lines():
            handle.set_linewidth(1.6)
    elif len(labeled) > _MAX_LABELS_INSIDE:
        # A legend beside the frame hides no curve. Its order is that of the curves' right ends.
        handles, labels = target.get_legend_handles_labels()
        order = np.argsort([-float(np.asarray(line.y)[-1]) for line in labeled])
        target.legend(
            [handles[i] for i in order],
            [labels[i] for i in order],
            fontsize=8,
            frameon=False,
            labelcolor=TEXT_COLOR,
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
        )
