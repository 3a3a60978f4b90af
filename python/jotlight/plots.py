"""Figures of compared images and of training runs.

The functions do not use pyplot, so they change no global state and need no display.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import positive_number, refuse_masked, require_intensities, to_array
from jotlight.errors import counted
from jotlight.figure_style import INK, MARK, QUIET
from jotlight.files import atomic_write
from jotlight.networks.figure import draw_layers
from jotlight.networks.network import Network
from jotlight.networks.planes_network import PlanesNetwork
from jotlight.output_files import open_output
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.training.history import History

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Rectangle

    from jotlight.figures import Figure

__all__ = ["Panel", "bits_panel", "comparison", "training"]


def __dir__() -> list[str]:
    return __all__


_COLUMNS = 5
"""Maximum number of images in a row."""
_SIDE, _TEXT, _GAP = 3.2, 0.5, 0.08
"""Lengths in inches: width of an image, height of the text above it, gap between items."""

FIGURES = (".png", ".jpg", ".jpeg", ".pdf", ".svg")
"""File name extensions of figures."""


def check_figure(path: Path) -> None:
    """Raise ValueError unless `path` has the extension of a figure."""
    if path.suffix.lower() not in FIGURES:
        raise ValueError(f"{path}: expected a name that ends in {', '.join(FIGURES)}")


def save_figure(
    figure: Figure, path: Path, *, dpi: float = 110, note: Mapping[str, Any] | None = None
) -> None:
    """Write a figure in the format of its extension, completely or not at all.

    `note` is a record of its origin, as values that JSON can hold.
    """
    kind = path.suffix[1:].lower()
    options: dict[str, Any] = {}
    if note is not None:
        text = json.dumps(dict(note))
        if kind in ("jpg", "jpeg"):
            options = {"pil_kwargs": {"comment": text.encode()}}
        else:
            options = {"metadata": {"Subject" if kind == "pdf" else "Description": text}}
    with atomic_write(path) as temporary, open_output(temporary) as file:
        figure.savefig(file, format=kind, dpi=dpi, **options)


@dataclasses.dataclass(frozen=True)
class Panel:
    """An image (H, W) or (H, W, 3) in units of intensity, with the text above it.

    Parameters
    ----------
    title : str
        The first line of the text.
    subtitle : str
        The second line.
    image : ndarray of float
        The image.
    detail : ndarray of float, optional
        The image at an integer multiple of its size, for the crop. Default: `image`.

    Raises
    ------
    TypeError, ValueError
        When the image is not an array of finite floats of such a shape.
    """

    title: str
    subtitle: str
    image: npt.NDArray[np.floating]
    detail: npt.NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        for name in ("image", "detail"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _checked(name, value))


def comparison(panels: Sequence[Panel], heading: str, *, white: float = 1.0) -> Figure:
    """Return a figure of images of one scene, each with an enlarged crop below it.

    All crops show the part of the scene that has the strongest edges in the first image. Intensity
    `white` is shown as white.

    Raises
    ------
    TypeError, ValueError
        When there is no panel, or the images differ in their size, or `white` is not above 0.

    Examples
    --------
    >>> image = np.eye(32)
    >>> figure = comparison([Panel("truth", "", image), Panel("half", "", image / 2)], "Two images")
    >>> len(figure.axes)  # each image and its crop
    4
    """
    from jotlight.figures import Figure

    positive_number("white", white)
    height, width = _common_size(panels)
    top, left, tall, wide = find_detail(panels[0].image)
    rows = math.ceil(len(panels) / _COLUMNS)
    columns = math.ceil(len(panels) / rows)
    image_height, crop_height = _SIDE * height / width, _SIDE * tall / wide
    cell_height = _TEXT + image_height + _GAP + crop_height + 2 * _GAP
    total_width = columns * (_SIDE + _GAP) + _GAP
    total_height = rows * cell_height + _TEXT
    figure = Figure(total_width, total_height, layout=None)

    def axes_at(x: float, y: float, axes_height: float) -> Axes:
        """Return axes whose top left corner is x, y inches from that of the figure."""
        bottom = 1 - (y + axes_height) / total_height
        size = (_SIDE / total_width, axes_height / total_height)
        axes = figure.add_axes((x / total_width, bottom, *size))
        axes.set_axis_off()
        return axes

    figure.text(
        _GAP / total_width, 1 - 0.1 / total_height, heading, fontsize=11, color=INK, va="top"
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
            color=INK,
            fontweight="bold",
        )
        figure.text(
            x / total_width, 1 - (y - 0.07) / total_height, panel.subtitle, fontsize=9, color=QUIET
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


def bits_panel(bits: Bits | Readings, oversampling: int) -> Panel:
    """Return a panel of the first frame: one jot per pixel, and all jots in the crop.

    The largest reading of several bits is white.
    """
    first, frames = np.asarray(bits[0], np.float32), len(bits)
    if isinstance(bits, Bits):
        title, state = "bits", f"{bits.counts(1).sum() / math.prod(bits.shape):.0%} ones"
    else:
        first /= 2**bits.bit_depth - 1
        mean = bits.sum().sum() / math.prod(bits.shape)
        title, state = f"readings of {bits.bit_depth} bits", f"{mean:.3g} on average"
    jots = (
        f"{oversampling} × {oversampling} jots per pixel" if oversampling > 1 else "1 jot per pixel"
    )
    return Panel(
        title,
        f"{counted(frames, 'frame')}, {jots}, {state}",
        first[::oversampling, ::oversampling],
        first,
    )


def training(network: Network | PlanesNetwork, history: History) -> Figure:
    """Return a figure of a training run: curves in the top row, splines and filters below."""
    from jotlight.figures import Figure

    figure = Figure(11, 6.2)
    axes = figure.subplots(2, 3)
    history.draw(axes[0])
    draw_layers(axes[1], network.layers)
    return figure


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


def _checked(name: str, image: npt.ArrayLike) -> npt.NDArray[np.floating]:
    """Return an image (H, W) or (H, W, 3) of finite floats, or raise TypeError or ValueError."""
    refuse_masked(name, image, "pass image.filled(0), or another value for masked pixels")
    values = to_array(name, image)
    require_intensities(name, values)
    if values.shape[2:] not in ((), (1,), (3,)) or values.ndim < 2 or values.size == 0:
        raise ValueError(f"{name}: expected shape (H, W) or (H, W, 3), got {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: expected finite values, got NaN or infinity")
    return values


def _common_size(panels: Sequence[Panel]) -> tuple[int, int]:
    """Return the height and the width of the images of all panels."""
    if isinstance(panels, Mapping) or not all(isinstance(each, Panel) for each in panels):
        raise TypeError(
            "panels: expected a list of panels, such as "
            '[jotlight.plots.Panel("title", "below", image)]'
        )
    sizes = sorted({each.image.shape[:2] for each in panels})
    if len(sizes) != 1:
        got = " and ".join(map(str, sizes[:2])) or "none"
        raise ValueError(f"panels: expected one or more images of one size, got {got}")
    height, width = sizes[0]
    return height, width


def _show(axes: Axes, image: npt.NDArray[np.floating], white: float) -> None:
    shown = np.clip(image / white, 0, 1)
    interpolation = "nearest" if min(shown.shape[:2]) < 400 else "auto"
    axes.imshow(shown, cmap="gray", vmin=0, vmax=1, interpolation=interpolation)


def _frame(left: float, top: float, width: float, height: float, *, line: float) -> Rectangle:
    from matplotlib.patches import Rectangle

    corner = (left - 0.5, top - 0.5)
    return Rectangle(corner, width, height, fill=False, edgecolor=MARK, linewidth=line)
