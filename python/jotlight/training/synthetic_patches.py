"""Synthetic patches: flat regions, gradients, gratings, rings, overlapping shapes, lines, text."""

import math
import string
from collections.abc import Callable
from functools import partial

import numpy as np

from jotlight.array_types import Image
from jotlight.checks import number_in_range
from jotlight.squares import repeat_squares
from jotlight.training.patch_sources import Patch, PatchSource

_IMAGE_MEAN = 0.5
"""Mean intensity of the image that a synthetic patch stands for."""

_SUPERSAMPLING = 3
"""Rows and columns that are drawn for a pixel, so that edges lie anywhere in a pixel."""

_EXTREME_LEVELS = 1 / 4
"""Fraction of the levels that are black or white."""

_MAX_SIDE = 4096


class SyntheticPatches(PatchSource):
    """Random drawings with intensities in [0, 1], which teach a network structure.

    The fraction `fine` of them are fine drawings, by default none. Of the others, one in seven each
    shows a flat region or a gradient, a grating, rings, overlapping disks, overlapping rectangles,
    lines, and text.

    Parameters
    ----------
    fine : float, optional
        Fraction of fine drawings, in [0, 1]: rings, gratings with a period of 2 to 3.5 pixels, and
        small text whose strokes follow the pixels. They teach networks fine text and gratings,
        and color networks that fine gray structure is not colored. Default: 0.

    Examples
    --------
    >>> patch = SyntheticPatches().draw(np.random.default_rng(0), 48)
    >>> patch.values.shape, patch.image_mean
    ((48, 48), 0.5)
    """

    max_side = _MAX_SIDE

    def __init__(self, *, fine: float = 0.0) -> None:
        self.fine = number_in_range("fine", fine, 0, 1)

    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random drawing."""
        drawings = _FINE_DRAWINGS if rng.random() < self.fine else _DRAWINGS
        drawing = drawings[rng.integers(len(drawings))]
        canvas = drawing(rng, side * _SUPERSAMPLING)
        blocks = canvas.reshape(side, _SUPERSAMPLING, side, _SUPERSAMPLING)
        return Patch(blocks.mean((1, 3), dtype=np.float32), _IMAGE_MEAN)

    def fingerprint(self) -> str:
        """Return the name of the class, and the fraction of fine drawings."""
        return f"{type(self).__name__} {self.fine}"


def _level(rng: np.random.Generator) -> float:
    if rng.random() < _EXTREME_LEVELS:
        return float(rng.integers(2))
    return float(rng.random())


def _two_levels(rng: np.random.Generator) -> tuple[float, float]:
    """Return two levels, which are black and white in half of the drawings."""
    if rng.random() < 1 / 2:
        black = float(rng.integers(2))
        return black, 1 - black
    return _level(rng), _level(rng)


def _projection(rng: np.random.Generator, side: int) -> Image:
    """Return the position of each point along a random direction, in points from the center."""
    angle = rng.uniform(0, math.pi)
    positions = np.arange(side, dtype=np.float32) - np.float32((side - 1) / 2)
    along = math.sin(angle) * positions[:, None] + math.cos(angle) * positions
    return np.asarray(along, np.float32)


def _draw_gradient(rng: np.random.Generator, side: int) -> Image:
    """Return a linear gradient between two levels, or a flat region."""
    first = _level(rng)
    last = first if rng.random() < 1 / 2 else _level(rng)
    fraction = (_projection(rng, side) / side + 0.5).clip(0, 1)
    return np.asarray(first + (last - first) * fraction, np.float32)


def _draw_grating(rng: np.random.Generator, side: int, longest: float = 32.0) -> Image:
    """Return a sine or square wave with a period from 2 to `longest` pixels."""
    first, last = _two_levels(rng)
    period = _SUPERSAMPLING * 2 ** rng.uniform(1, math.log2(longest))
    phase = 2 * math.pi * (_projection(rng, side) / period + rng.random())
    wave = np.sin(phase)
    if rng.random() < 1 / 2:
        wave = np.sign(wave)
    return np.asarray(first + (last - first) * (wave + 1) / 2, np.float32)


def _draw_rings(rng: np.random.Generator, side: int) -> Image:
    """Return a part of a zone plate: rings with up to 0.6 cycles per pixel, finer to the outside.

    The frequency in the middle of the patch is uniform, so fine rings are as likely as coarse ones.
    """
    first, last = _two_levels(rng)
    # The frequency rises by this number with each point from the center of the rings.
    slope = 2 ** rng.uniform(-10, -6) / _SUPERSAMPLING**2
    distance = rng.uniform(0, 0.6) / _SUPERSAMPLING / slope
    angle = rng.uniform(0, 2 * math.pi)
    positions = np.arange(side, dtype=np.float32) - np.float32((side - 1) / 2)
    row, column = math.sin(angle) * distance, math.cos(angle) * distance
    squares = (positions[:, None] - row) ** 2 + (positions - column) ** 2
    wave = np.sin(2 * math.pi * (slope / 2 * squares + rng.random()))
    return np.asarray(first + (last - first) * (wave + 1) / 2, np.float32)


def _draw_disks(rng: np.random.Generator, side: int) -> Image:
    """Return overlapping disks, whose number per radius r falls as r^-3, as in photographs."""
    y, x = np.ogrid[:side, :side]
    canvas = np.full((side, side), _level(rng), np.float32)
    smallest = 1.5 * _SUPERSAMPLING
    largest = max(smallest, side / 2)
    inverse_squares = rng.uniform(largest**-2, smallest**-2, 80)
    for radius in np.sort(inverse_squares**-0.5)[::-1]:
        row, column = rng.uniform(-radius, side + radius, 2)
        top, left = (max(0, math.floor(center - radius)) for center in (row, column))
        bottom, right = (math.ceil(center + radius) + 1 for center in (row, column))
        part = slice(top, max(top, bottom)), slice(left, max(left, right))
        inside = (y[part[0]] - row) ** 2 + (x[:, part[1]] - column) ** 2 <= radius**2
        canvas[part][inside] = _level(rng)
    return canvas


def _draw_rectangles(rng: np.random.Generator, side: int) -> Image:
    """Return overlapping rectangles of one random orientation, as in buildings."""
    along = _projection(rng, side)
    across = np.rot90(along)
    canvas = np.full((side, side), _level(rng), np.float32)
    for _ in range(12):
        row, column = rng.uniform(-side / 2, side / 2, 2)
        height, width = np.exp(rng.uniform(math.log(_SUPERSAMPLING), math.log(side), 2))
        inside = (abs(along - row) <= height / 2) & (abs(across - column) <= width / 2)
        canvas[inside] = _level(rng)
    return canvas


def _draw_lines(rng: np.random.Generator, side: int) -> Image:
    """Return lines of 1 to 4 pixels in width on a uniform background."""
    canvas = np.full((side, side), _level(rng), np.float32)
    for _ in range(rng.integers(1, 9)):
        width = _SUPERSAMPLING * 2 ** rng.uniform(0, 2)
        offset = rng.uniform(-side / 2, side / 2)
        canvas[abs(_projection(rng, side) - offset) <= width / 2] = _level(rng)
    return canvas


def _draw_text(rng: np.random.Generator, side: int) -> Image:
    """Return lines of random letters and digits, 6 to 24 pixels high."""
    from PIL import Image, ImageDraw, ImageFont

    height = _SUPERSAMPLING * 2 ** rng.uniform(math.log2(6), math.log2(24))
    font = ImageFont.load_default(height)
    alphabet = list(string.ascii_letters + string.digits + "  ")
    rows = math.ceil(side / height)
    lines = ["".join(rng.choice(alphabet, math.ceil(3 * side / height))) for _ in range(rows)]
    image = Image.new("L", (side, side), round(255 * _level(rng)))
    corner = tuple(rng.uniform(-height, 0, 2))
    ink = round(255 * _level(rng))
    ImageDraw.Draw(image).multiline_text(corner, "\n".join(lines), fill=ink, font=font)
    return np.rot90(np.asarray(image, np.float32) / np.float32(255), int(rng.integers(4)))


def _draw_small_text(rng: np.random.Generator, side: int) -> Image:
    """Return random words in letters of 8 to 16 pixels, whose strokes follow the pixels."""
    from PIL import Image, ImageDraw, ImageFont

    pixels = side // _SUPERSAMPLING
    height = int(rng.integers(8, 17))
    font = ImageFont.load_default(height)
    alphabet = list(string.ascii_letters + string.digits + "    ")
    paper, ink = (round(255 * level) for level in _two_levels(rng))
    image = Image.new("L", (pixels, pixels), paper)
    draw = ImageDraw.Draw(image)
    draw.fontmode = "L" if rng.random() < 1 / 2 else "1"  # gray or sharp edges
    row = -int(rng.integers(0, 16))
    while row < pixels:
        line = "".join(rng.choice(alphabet, pixels // 2))
        draw.text((-int(rng.integers(0, 16)), row), line, fill=ink, font=font)
        row += int(rng.integers(height, 2 * height))
    small = np.rot90(np.asarray(image, np.float32) / np.float32(255), int(rng.integers(4)))
    return repeat_squares(small, _SUPERSAMPLING)


_DRAWINGS: tuple[Callable[[np.random.Generator, int], Image], ...] = (
    _draw_gradient,
    _draw_grating,
    _draw_rings,
    _draw_disks,
    _draw_rectangles,
    _draw_lines,
    _draw_text,
)

_FINE_DRAWINGS = _draw_rings, partial(_draw_grating, longest=3.5), _draw_small_text
