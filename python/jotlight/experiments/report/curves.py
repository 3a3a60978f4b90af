"""Curves as SVG, in colours that a page can change for its dark side."""

import dataclasses
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Place

INK, QUIET = "#1d2733", "#5b6876"
"""Of words and lines; pages may put other colours in their place."""

COLOURS = {
    "mle": "#8a8f98",
    "noniterative-gaussian": "#3f9fdc",
    "noniterative-tv": "#2f6fb7",
    "noniterative-nlm": "#b865a3",
    "noniterative-bm3d": "#0f9d74",
    "noniterative-bm3d-algebraic": "#5bb898",
    "admm-tv": "#c98a00",
    "network-initial": "#a58c6f",
    "network-two-layer": "#d55e00",
}
"""The methods' colours, the same in every figure."""

_MOST_INSIDE = 3
"""Curves whose legend has room among them."""


@dataclasses.dataclass(frozen=True)
class Line:
    """A curve."""

    label: str
    x: npt.ArrayLike
    y: npt.ArrayLike
    color: str
    marker: str = ""
    dashed: bool = False
    width: float = 1.6


@dataclasses.dataclass(frozen=True)
class Axes:
    """Curves in one frame."""

    lines: Sequence[Line]
    x: str
    y: str
    title: str = ""
    x_log: bool = False
    y_log: bool = False
    ticks: Sequence[float] | None = None
    """Where to write numbers along x."""


def draw(places: Sequence[Axes]) -> str:
    """Draw frames side by side; the same curves give the same SVG.

    Examples
    --------
    >>> draw([Axes([Line("a", [0, 1], [0, 1], color="#d55e00")], x="x", y="y")])[:5]
    '<?xml'
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    style: Any = {
        # Words stay words, so that a page sets them in its own type and readers can search them.
        "svg.fonttype": "none",
        "svg.hashsalt": "jotlight",
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans"],
        "text.color": INK,
        "axes.labelcolor": INK,
        "axes.edgecolor": QUIET,
        "xtick.color": QUIET,
        "ytick.color": QUIET,
        "axes.spines.top": False,
        "axes.spines.right": False,
    }
    with rc_context(style):
        figure = Figure(figsize=(max(7.4, 4.6 * len(places)), 3.8), layout="constrained")
        figure.patch.set_alpha(0)
        for place, axes in zip(
            figure.subplots(1, len(places), squeeze=False)[0], places, strict=True
        ):
            _fill(place, axes)
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def _fill(place: "Place", axes: Axes) -> None:
    place.patch.set_alpha(0)
    for line in axes.lines:
        place.plot(
            line.x,
            line.y,
            label=line.label or None,
            color=line.color,
            marker=line.marker or None,
            markersize=7 if np.size(line.x) == 1 else 4,
            linestyle="--" if line.dashed else "-",
            linewidth=line.width,
        )
    place.set_xlabel(axes.x)
    place.set_ylabel(axes.y)
    if axes.title:
        place.set_title(axes.title, fontsize=11, loc="left", color=INK)
    if axes.x_log:
        place.set_xscale("log")
    if axes.y_log:
        place.set_yscale("log")
    if axes.ticks is not None:
        place.set_xticks(axes.ticks, [f"{tick:g}" for tick in axes.ticks])
        place.minorticks_off()
    place.grid(visible=True, color=QUIET, alpha=0.25, linewidth=0.6)
    labelled = [line for line in axes.lines if line.label]
    if 1 < len(labelled) <= _MOST_INSIDE:
        legend = place.legend(fontsize=8, frameon=False, labelcolor=INK)
        for handle in legend.get_lines():
            handle.set_linewidth(1.6)
    elif len(labelled) > _MOST_INSIDE:
        # Beside the frame, where it hides no curve, from the highest end of a curve to the lowest.
        handles, labels = place.get_legend_handles_labels()
        order = np.argsort([-float(np.asarray(line.y)[-1]) for line in labelled])
        place.legend(
            [handles[i] for i in order],
            [labels[i] for i in order],
            fontsize=8,
            frameon=False,
            labelcolor=INK,
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
        )
