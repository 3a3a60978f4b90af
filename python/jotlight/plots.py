"""Figures of compared images, training runs, and plans.

The functions do not use pyplot, so they change no global state and need no display.
"""

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight.estimators.planning import Plan
from jotlight.files import atomic_write
from jotlight.networks.layer import Layer
from jotlight.networks.network import Network
from jotlight.output_files import open_output
from jotlight.sensing.bits import Bits
from jotlight.training.history import History

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

_COLUMNS = 5
"""Maximum number of images in a row."""
_MAX_CURVES = 12
"""Maximum number of splines or filters drawn per layer."""
_SIDE, _TEXT, _GAP = 3.2, 0.5, 0.08
"""Lengths in inches: width of an image, height of the text above it, gap between items."""
_INK, _QUIET, _MARK = "#1d2733", "#5b6876", "#e4572e"
"""Colors of titles, of secondary text, and of frames and curves."""

FIGURES = (".png", ".jpg", ".jpeg", ".pdf", ".svg")
"""File name extensions of figures."""


def check_figure(path: Path) -> None:
    """Raise ValueError unless `path` has the extension of a figure."""
    if path.suffix.lower() not in FIGURES:
        raise ValueError(f"{path}: expected a name that ends in {', '.join(FIGURES)}")


def save_figure(figure: "Figure", path: Path, *, dpi: float = 110) -> None:
    """Write a figure in the format of its extension, completely or not at all."""
    with atomic_write(path) as temporary, open_output(temporary) as file:
        figure.savefig(file, format=path.suffix[1:].lower(), dpi=dpi)


@dataclasses.dataclass(frozen=True)
class Panel:
    """An image (H, W) or (H, W, 3) in units of intensity, with the text above it."""

    title: str
    subtitle: str
    image: npt.NDArray[np.floating]
    detail: npt.NDArray[np.floating] | None = None
    """The image at an integer multiple of its size, for the crop. Default: `image`."""


def comparison(panels: list[Panel], heading: str, *, white: float = 1.0) -> "Figure":
    """Return a figure of images of one scene, each with an enlarged crop below it.

    All crops show the part of the scene that has the strongest edges in the first image. Intensity
    `white` is shown as white.

    Examples
    --------
    >>> image = np.eye(32)
    >>> figure = comparison([Panel("truth", "", image), Panel("half", "", image / 2)], "Two images")
    >>> len(figure.axes)  # each image and its crop
    4
    """
    from matplotlib.figure import Figure

    height, width = panels[0].image.shape[:2]
    top, left, tall, wide = find_detail(panels[0].image)
    rows = math.ceil(len(panels) / _COLUMNS)
    columns = math.ceil(len(panels) / rows)
    image_height, crop_height = _SIDE * height / width, _SIDE * tall / wide
    cell_height = _TEXT + image_height + _GAP + crop_height + 2 * _GAP
    total_width = columns * (_SIDE + _GAP) + _GAP
    total_height = rows * cell_height + _TEXT
    figure = Figure(figsize=(total_width, total_height), facecolor="white")

    def axes_at(x: float, y: float, axes_height: float) -> "Axes":
        """Return axes whose top left corner is x, y inches from that of the figure."""
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
        above = axes_at(x, y, image_height)
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
        _show(above, panel.image, white)
        above.add_patch(_frame(left, top, wide, tall, line=1))
        fine = panel.image if panel.detail is None else panel.detail
        scale = fine.shape[0] // height
        crop = fine[top * scale : (top + tall) * scale, left * scale : (left + wide) * scale]
        below = axes_at(x, y + image_height + _GAP, crop_height)
        _show(below, crop, white)
        below.add_patch(_frame(0, 0, wide * scale, tall * scale, line=2))
    return figure


def bits_panel(bits: Bits, oversampling: int) -> Panel:
    """Return a panel of the first frame: one jot per pixel, and all jots in the crop."""
    first = bits[:1].to_array()[0].astype(np.float32)
    frames = len(bits)
    fraction = float(bits.counts(1).sum()) / np.prod(bits.shape)
    jots = (
        f"{oversampling} × {oversampling} jots per pixel" if oversampling > 1 else "1 jot per pixel"
    )
    return Panel(
        "bits",
        f"{frames} frame{'' if frames == 1 else 's'}, {jots}, {fraction:.0%} ones",
        first[::oversampling, ::oversampling],
        first,
    )


def training(network: Network, history: History) -> "Figure":
    """Return a figure of a training run: curves in the top row, splines and filters below."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 6.2), facecolor="white", layout="constrained")
    axes = figure.subplots(2, 3)
    tests, unit = ("test PSNR, dB", history.test_psnr), ""
    if np.isfinite(history.held_out).any():
        tests, unit = ("held out, nats per bit", history.held_out), ", nats per bit"
    measured = np.isfinite(tests[1])
    curves = [
        (f"cost ε{unit}", history.steps, history.loss, "log"),
        ("gradient norm ‖∇ε‖", history.steps, history.gradient_norm, "log"),
        (tests[0], history.steps[measured], tests[1][measured], "linear"),
    ]
    for place, (title, x, y, scale) in zip(axes[0], curves, strict=True):
        _title(place, title)
        place.set_xlabel("step", color=_QUIET)
        if len(x):
            place.set_yscale(scale)
            # Each step uses different patches, so the curve is noisy. The moving average over a
            # hundredth of the run shows the trend.
            span = max(1, len(y) // 100)
            mean = np.convolve(y, np.full(span, 1 / span), "valid")
            place.plot(x, y, color=_MARK, linewidth=1, alpha=1 if span == 1 else 0.3)
            place.plot(x[span // 2 :][: len(mean)], mean, color=_MARK, linewidth=1)
        else:
            place.text(0.5, 0.5, "no test images", ha="center", transform=place.transAxes)
            place.set_axis_off()
    layers = list(enumerate(network.layers))
    with_splines = [number for number, layer in layers if layer.coefficients is not None]
    trained = [
        number for number in with_splines if network.layers[number].trainable == "all"
    ] or with_splines
    for place, numbers in ((axes[1, 0], trained[:1]), (axes[1, 2], trained[-1:])):
        for number in numbers:
            _draw_splines(place, number, network.layers[number])
    later = [number for number, layer in layers[1:] if layer.trainable != "nothing"]
    number = later[0] if later else 0
    _draw_filters(figure, axes[1, 1], number, network.layers[number])
    return figure


def expectation(plan: Plan) -> "Figure":
    """Return a figure of a plan: PSNR over frames on the left, SNR over light on the right."""
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
        color = f"C{place}"
        label = f"{plan.frames[row]} frame{'' if plan.frames[row] == 1 else 's'}"
        right.plot(plan.light, plan.snr[row], color=color, label=label, **style)
        right.plot(plan.light, plan.snr_bound[row], color=color, linestyle=":", linewidth=1)
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
    _title(axes, f"φ of layer {number}{_limit_note(len(splines))}")


def _draw_filters(figure: "Figure", axes: "Axes", number: int, layer: Layer) -> None:
    """Draw the first filters of a layer side by side, for the first input channel only."""
    filters = layer.filters[:, 0] if layer.filters.ndim == 4 else layer.filters[0, :, 0]
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
    plural = "" if len(filters) == 1 else "s"
    _title(axes, f"filter{plural} of layer {number}{_limit_note(len(filters))}")
    figure.colorbar(image, ax=axes, shrink=0.9)


def _limit_note(number: int) -> str:
    """Return the end of a title that says how many of `number` splines or filters are drawn."""
    return f", {_MAX_CURVES} of {number}" if number > _MAX_CURVES else ""


def _title(axes: "Axes", title: str) -> None:
    axes.set_title(title, fontsize=11, color=_INK, loc="left")


def find_detail(image: npt.NDArray[np.floating]) -> tuple[int, int, int, int]:
    """Return top, left, height, and width of the part of an image with the strongest edges.

    The part is a quarter as wide as the image.
    """
    from scipy.ndimage import gaussian_gradient_magnitude, uniform_filter

    gray = image.mean(axis=2) if image.ndim == 3 else image
    height, width = gray.shape
    wide = max(1, width // 4)
    tall = max(1, min(height, round(wide * 0.6)))
    # The Gaussian suppresses texture and noise, but not edges.
    edges = gaussian_gradient_magnitude(gray.astype(np.float64), 2)
    energy = uniform_filter(edges, (tall, wide), mode="constant")
    inside = energy[tall // 2 : height - (tall - 1) // 2, wide // 2 : width - (wide - 1) // 2]
    top, left = np.unravel_index(int(inside.argmax()), inside.shape)
    return int(top), int(left), tall, wide


def _show(axes: "Axes", image: npt.NDArray[np.floating], white: float) -> None:
    shown = np.clip(image / white, 0, 1)
    interpolation = "nearest" if min(shown.shape[:2]) < 400 else "auto"
    axes.imshow(shown, cmap="gray", vmin=0, vmax=1, interpolation=interpolation)


def _frame(left: float, top: float, width: float, height: float, *, line: float) -> "Rectangle":
    from matplotlib.patches import Rectangle

    corner = (left - 0.5, top - 0.5)
    return Rectangle(corner, width, height, fill=False, edgecolor=_MARK, linewidth=line)
