"""Blind spots: pixels whose only bit is hidden from the network, which has to predict it.

A single bit cannot be split into an input and a target. But the noise of neighboring pixels is
independent, so they do not predict the noise of a hidden bit.
"""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Integers
from jotlight.estimators.trial_levels import fill_from_nearest

FRACTION = 0.1
"""Fraction of the pixels whose bits are hidden in a step."""

_RADIUS = 2
"""Largest distance in rows and columns of the pixel that replaces a hidden one."""

_ATTEMPTS = 8
"""Number of random neighbors that are tried before the nearest pixel is taken."""


def draw_blind_spots(
    rng: np.random.Generator, known: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Return which of the known pixels (H, W) are hidden in a step."""
    return known & (rng.random(known.shape) < FRACTION)


def fill_blind_spots(
    rng: np.random.Generator, ones: Integers, known: npt.NDArray[np.bool_]
) -> Integers:
    """Return bits (H, W) whose unknown pixels have the bit of a random known neighbor.

    The network cannot distinguish such a pixel from the others. So what it learns at hidden pixels
    holds for all.

    Examples
    --------
    >>> known = np.array([[True, False, True, True]])
    >>> fill_blind_spots(np.random.default_rng(0), np.array([[1, 0, 1, 1]]), known)
    array([[1, 1, 1, 1]])
    """
    if not known.any():
        return ones
    filled = fill_from_nearest(ones.astype(np.float32), known).astype(np.int64)
    missing = np.argwhere(~known)
    for _ in range(_ATTEMPTS):
        steps = rng.integers(-_RADIUS, _RADIUS + 1, missing.shape)
        places = np.clip(missing + steps, 0, np.array(known.shape) - 1)
        found = known[tuple(places.T)]
        filled[tuple(missing[found].T)] = ones[tuple(places[found].T)]
        missing = missing[~found]
    return filled
