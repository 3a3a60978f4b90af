"""Figures. Made without pyplot, so that nothing global is touched and no display is needed."""

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight.estimators.planning import Plan
from jotlight.networks.layer import Layer
from jotlight.networks.network import Network
from jotlight.sensing.bits import Bits
from jotlight.training.history import History

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

_COLUMNS = 5
_MOST = 12
"""Splines or filters of a layer that are drawn, at most."""
_SIDE, _TEXT, _GAP = 3.2, 0.5, 0.08
"""Inches: the width of a picture, the height of the words above it, the space between things."""
_INK, _QUIET, _MARK = "#1d2733", "#5b6876", "#e4572e"


FIGURES = (".png", ".jpg", ".jpeg", ".pdf", ".svg")
"""The endings that a figure's name may have."""


def check_figure(path: Path) -> None:
    """Raise ValueError for a name that no figure can have, before it is drawn."""
    if path.suffix.lower() not in FIGURES:
        raise ValueError(f"{path}: expected a name that ends in {', '.join(FIGURES)}")


@dataclasses.dataclass(frozen=True)
class Panel:
    """A picture (H, W) or (H, W, 3) in units of intensity, with what to write above it."""

    title: str
    subtitle: str
    picture: npt.NDArray[np.floating]
    detail: npt.NDArray[np.floating] | None = None
    """The picture at a finer scale, a whole multiple of its size; the crop is taken from it."""


def comparison(panels: list[Panel], heading: str, *, white: float = 1.0) -> "Figure":
    """Draw pictures of one scene side by side, each with the same crop enlarged below it.

    The crop is the part of the first picture that has most detail.
    """
    from matplotlib.figure import Figure

    height, width = panels[0].picture.shape[:2]
    top, left, tall, wide = most_detailed(panels[0].picture)
    rows = math.ceil(len(panels) / _COLUMNS)
    columns = math.ceil(len(panels) / rows)
    picture_height, crop_height = _SIDE * height / width, _SIDE * tall / wide
    cell_height = _TEXT + picture_height + _GAP + crop_height + 2 * _GAP
    total_width = columns * (_SIDE + _GAP) + _GAP
    total_height = rows * cell_height + _TEXT
    figure = Figure(figsize=(total_width, total_height), facecolor="white")

    def axes_at(x: float, y: float, axes_height: float) -> "Axes":
        """Axes with their top left corner at x, y inches from the figure's."""
        bottom = 1 - (y + axes_height) / total_height
        size = (_SIDE / total_width, axes_height / total_height)
        axes = figure.add_axes((x / total_width, bottom, *size))
        axes.set_axis_off()
        return axes

    figure.text(
        _GAP / total_width, 1 - 0.1 / total_height, heading, fontsize=11, color=_INK, va="top"
    )
    for index, panel in enumerate(panels):
        x = _GAP + (index % columns) * (_SIDE + _GAP)
        y = 2 * _TEXT + (index // columns) * cell_height
        above = axes_at(x, y, picture_height)
        figure.text(
            x / total_width,
            1 - (y - 0.26) / total_height,
            panel.title,
            fontsize=11,
            color=_INK,
            fontweight="bold",
        )
        figure.text(
            x / total_width, 1 - (y - 0.07) / total_height, panel.subtitle, fontsize=9, color=_QUIET
        )
        _show(above, panel.picture, white)
        above.add_patch(_frame(left, top, wide, tall, line=1))
        fine = panel.picture if panel.detail is None else panel.detail
        scale = fine.shape[0] // height
        crop = fine[top * scale : (top + tall) * scale, left * scale : (left + wide) * scale]
        below = axes_at(x, y + picture_height + _GAP, crop_height)
        _show(below, crop, white)
        below.add_patch(_frame(0, 0, wide * scale, tall * scale, line=2))
    return figure


def bits_panel(bits: Bits, oversampling: int) -> Panel:
    """One frame of bits: of each pixel a single jot, and in the crop all of them."""
    first = bits[:1].to_array()[0].astype(np.float32)
    frames = len(bits)
    share = float(bits.counts(1).sum()) / np.prod(bits.shape)
    jots = (
        f"{oversampling} × {oversampling} jots per pixel" if oversampling > 1 else "1 jot a pixel"
    )
    return Panel(
        "bits",
        f"{frames} frame{'' if frames == 1 else 's'}, {jots}, {share:.0%} ones",
        first[::oversampling, ::oversampling],
        first,
    )


def training(network: Network, history: History) -> "Figure":
    """Draw how a run went above, and what was learned below: splines and filters."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 6.2), facecolor="white", layout="constrained")
    axes = figure.subplots(2, 3)
    tests, told = ("test PSNR, dB", history.test_psnr), ""
    if np.isfinite(history.held_out).any():
        tests, told = ("held out, nats per bit", history.held_out), ", nats per bit"
    measured = np.isfinite(tests[1])
    curves = [
        (f"cost ε{told}", history.steps, history.loss, "log"),
        ("gradient norm ‖∇ε‖", history.steps, history.gradient_norm, "log"),
        (tests[0], history.steps[measured], tests[1][measured], "linear"),
    ]
    for place, (title, x, y, scale) in zip(axes[0], curves, strict=True):
        _title(place, title)
        place.set_xlabel("step", color=_QUIET)
        if len(x):
            place.set_yscale(scale)
            # Costs of other patches in each step: their mean over a hundredth of the run as well.
            span = max(1, len(y) // 100)
            mean = np.convolve(y, np.full(span, 1 / span), "valid")
            place.plot(x, y, color=_MARK, linewidth=1, alpha=1 if span == 1 else 0.3)
            place.plot(x[span // 2 :][: len(mean)], mean, color=_MARK, linewidth=1)
        else:
            place.text(0.5, 0.5, "no test images", ha="center", transform=place.transAxes)
            place.set_axis_off()
    layers = list(enumerate(network.layers))
    bent = [number for number, layer in layers if layer.coefficients is not None]
    learned = [number for number in bent if network.layers[number].trainable == "all"] or bent
    for place, numbers in ((axes[1, 0], learned[:1]), (axes[1, 2], learned[-1:])):
        for number in numbers:
            _draw_splines(place, number, network.layers[number])
    later = [number for number, layer in layers[1:] if layer.trainable != "nothing"]
    number = later[0] if later else 0
    _draw_filters(figure, axes[1, 1], number, network.layers[number])
    return figure


def expectation(plan: Plan) -> "Figure":
    """Draw what a plan expects: PSNR by frames to the left, SNR by light to the right."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), facecolor="white", layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(plan.frames, plan.psnr, color=_MARK, marker="o", markersize=4)
    left.set_xscale("log", base=2)
    if plan.target_psnr is not None:
        left.axhline(plan.target_psnr, color=_QUIET, linestyle=":")
    left.set_title("PSNR of the scene, dB", fontsize=11, color=_INK, loc="left")
    left.set_xlabel("frames", color=_QUIET)
    shown = range(len(plan.frames) - 1, -1, -max(1, len(plan.frames) // 5))
    style = {"marker": "o"} if len(plan.light) == 1 else {}
    for place, row in enumerate(shown):
        colour = f"C{place}"
        label = f"{plan.frames[row]} frame{'' if plan.frames[row] == 1 else 's'}"
        right.plot(plan.light, plan.snr[row], color=colour, label=label, **style)
        right.plot(plan.light, plan.snr_bound[row], color=colour, linestyle=":", linewidth=1)
    right.set_xscale("log")
    right.set_title(
        "SNR of a pixel, dB (dotted: Cramér-Rao bound)", fontsize=11, color=_INK, loc="left"
    )
    right.set_xlabel("photons per jot and frame", color=_QUIET)
    right.legend(fontsize=8, frameon=False)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return figure


def _draw_splines(axes: "Axes", number: int, layer: Layer) -> None:
    """Draw the splines of a layer, or the first ones; of many sets the middle one."""
    from scipy.interpolate import BSpline

    assert layer.coefficients is not None, "a layer with splines"
    every = layer.coefficients
    if every.ndim == 3:
        every = every[len(every) // 2]
    size = every.shape[1]
    knots = layer.start + layer.spacing * (np.arange(size + 4) - 3)
    z = np.linspace(knots[3], knots[-4], 500)
    for coefficients in every[:_MOST]:
        axes.plot(z, BSpline(knots, coefficients.astype(np.float64), 3)(z), linewidth=1.5)
    axes.grid(alpha=0.3)
    _title(axes, f"φ of layer {number}{_some(len(every))}")


def _draw_filters(figure: "Figure", axes: "Axes", number: int, layer: Layer) -> None:
    """Draw the filters of a layer on its first input, or the first ones, side by side."""
    every = layer.filters[:, 0] if layer.filters.ndim == 4 else layer.filters[0, :, 0]
    shown = every[:_MOST]
    columns = math.ceil(math.sqrt(len(shown)))
    rows = math.ceil(len(shown) / columns)
    height, width = every.shape[1:]
    # A pixel between two of them stays empty.
    sheet = np.full((rows * (height + 1) - 1, columns * (width + 1) - 1), np.nan)
    for index, taps in enumerate(shown):
        top, left = (index // columns) * (height + 1), (index % columns) * (width + 1)
        sheet[top : top + height, left : left + width] = taps
    largest = float(np.abs(shown).max()) or 1.0
    image = axes.imshow(sheet, cmap="RdBu_r", vmin=-largest, vmax=largest)
    axes.set_axis_off()
    _title(axes, f"filter{'' if len(every) == 1 else 's'} of layer {number}{_some(len(every))}")
    figure.colorbar(image, ax=axes, shrink=0.9)


def _some(number: int) -> str:
    return f", {_MOST} of {number}" if number > _MOST else ""


def _title(axes: "Axes", title: str) -> None:
    axes.set_title(title, fontsize=11, color=_INK, loc="left")


def most_detailed(picture: npt.NDArray[np.floating]) -> tuple[int, int, int, int]:
    """Top, left, height and width of the part, a quarter as wide, where grey levels vary most."""
    from scipy.ndimage import gaussian_gradient_magnitude, uniform_filter

    grey = picture.mean(axis=2) if picture.ndim == 3 else picture
    height, width = grey.shape
    wide = max(1, width // 4)
    tall = max(1, min(height, round(wide * 0.6)))
    # Edges, not the grain of grass or noise, which the smoothing takes away.
    slopes = gaussian_gradient_magnitude(grey.astype(np.float64), 2)
    energy = uniform_filter(slopes, (tall, wide), mode="constant")
    inside = energy[tall // 2 : height - (tall - 1) // 2, wide // 2 : width - (wide - 1) // 2]
    top, left = np.unravel_index(int(inside.argmax()), inside.shape)
    return int(top), int(left), tall, wide


def _show(axes: "Axes", picture: npt.NDArray[np.floating], white: float) -> None:
    shown = np.clip(picture / white, 0, 1)
    interpolation = "nearest" if min(shown.shape[:2]) < 400 else "auto"
    axes.imshow(shown, cmap="gray", vmin=0, vmax=1, interpolation=interpolation)


def _frame(left: float, top: float, width: float, height: float, *, line: float) -> "Rectangle":
    from matplotlib.patches import Rectangle

    corner = (left - 0.5, top - 0.5)
    return Rectangle(corner, width, height, fill=False, edgecolor=_MARK, linewidth=line)
