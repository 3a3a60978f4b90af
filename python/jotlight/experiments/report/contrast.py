"""Colors of drawings that are visible on the light and on the dark ground of a page."""

import numpy as np

GROUNDS = "#fcfbf9", "#14181d"
"""The light and the dark ground of the page, as its styles state them."""

_MIN_CONTRAST = 3.0
"""Least contrast of parts of a drawing with their ground (WCAG 2.1, criterion 1.4.11)."""


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colors, from 1 to 21.

    Examples
    --------
    >>> contrast("#ffffff", "#000000")
    21.0
    """
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def themed(color: str) -> str:
    """Return a color in the notation of CSS that is visible in the light and in the dark theme.

    A color with too little contrast is mixed with black or white, as little as is needed.

    Examples
    --------
    >>> themed("#d55e00")
    '#d55e00'
    >>> themed("#3d1a6e")
    'light-dark(#3d1a6e, #735a97)'
    """
    light, dark = (_visible_on(ground, color) for ground in GROUNDS)
    return color if light == dark else f"light-dark({light}, {dark})"


def _visible_on(ground: str, color: str) -> str:
    end = "#000000" if contrast("#000000", ground) > contrast("#ffffff", ground) else "#ffffff"
    mixtures = (_mixed(color, end, percent / 100) for percent in range(101))
    return next(each for each in mixtures if contrast(each, ground) >= _MIN_CONTRAST)


def _mixed(color: str, end: str, part: float) -> str:
    values = (1 - part) * _levels(color) + part * _levels(end)
    return "#" + bytes(np.rint(values).astype(np.uint8)).hex()


def _levels(color: str) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    return np.array(list(bytes.fromhex(color[1:])), np.float64)


def _luminance(color: str) -> float:
    level = _levels(color) / 255
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])
