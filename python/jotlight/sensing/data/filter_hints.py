"""The filters that the mean rates of the jots of a period suggest."""

import numpy as np

from jotlight.array_types import Array32

_MAX_RATIO = 0.25
"""Maximum difference of two filters that are alike, relative to that of the other two."""

_MIN_WHITE = 1.4
"""Minimum light of a white filter, relative to the brightest of the other three."""


def means_of_filters(rates: Array32, side: int) -> Array32:
    """Return the mean rate of each of the four squares of a period, (2, 2)."""
    height, width = (length // (2 * side) for length in rates.shape)
    whole = rates[: height * 2 * side, : width * 2 * side]
    return np.asarray(whole.reshape(height, 2, side, width, 2, side).mean(axis=(0, 2, 3, 5)))


def white_order(means: Array32, has_greens: bool) -> str | None:
    """Return an order of red, green, blue, and a white filter that sees much more light, or None.

    A red filter may also see much more light than two green ones. Blue is then the darkest one.

    Examples
    --------
    >>> white_order(np.float32([[1, 1], [1, 3]]), has_greens=True)
    'RGBW'
    >>> white_order(np.float32([[9, 4], [4, 1]]), has_greens=True) is None
    True
    """
    *others, brightest = np.sort(means, axis=None)
    are_alike = others[-1] - others[0] <= _MAX_RATIO * (brightest - np.mean(others))
    has_dark_blue = others[2] - others[1] < others[1] - others[0] and not are_alike
    if brightest < _MIN_WHITE * others[-1] or (has_greens and has_dark_blue):
        return None
    place = int(np.argmax(means))
    return "RGB"[:place] + "W" + "RGB"[place:]


def alternating(means: Array32) -> str | None:
    """Return whether only "rows" or only "columns" alternate, or None.

    Examples
    --------
    >>> alternating(np.float32([[1, 2], [1, 2]])), alternating(np.float32([[4, 9], [9, 1]]))
    ('columns', None)
    """
    down, right = (float(abs(np.diff(means, axis=axis)).max()) for axis in (0, 1))
    if min(down, right) > _MAX_RATIO * max(down, right):
        return None
    return "rows" if right < down else "columns"


def green_orders(means: Array32) -> str | None:
    """Return the orders of a Bayer mosaic whose green filters are on the jots of equal rates.

    Examples
    --------
    >>> green_orders(np.float32([[4, 9], [9, 1]]))
    'as in RGGB or BGGR'
    """
    main, other = abs(means[0, 0] - means[1, 1]), abs(means[0, 1] - means[1, 0])
    if min(main, other) > _MAX_RATIO * max(main, other):
        return None
    return "as in RGGB or BGGR" if other < main else "as in GRBG or GBRG"
