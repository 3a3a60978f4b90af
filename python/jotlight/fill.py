"""Pixels of which nothing is known."""

import warnings

import numpy as np
import numpy.typing as npt

from jotlight.errors import JotlightWarning


def fill_blind(
    image: npt.NDArray[np.float32], blind: npt.NDArray[np.bool_] | None
) -> npt.NDArray[np.float32]:
    """Fill blind pixels from their neighbours, from the rim of each hole inwards, and say so.

    A pixel becomes the mean of those of its 8 neighbours that are known; pixels filled in one
    round are known in the next.

    Raises
    ------
    ValueError
        When all pixels are blind.
    """
    if blind is None:
        return image
    if blind.all():
        raise ValueError("mask: expected at least one jot that is alive, got none")
    from scipy.ndimage import uniform_filter

    warnings.warn(
        f"{blind.sum()} of {blind.size} pixels have no valid jot and were filled from their "
        "neighbours",
        JotlightWarning,
        stacklevel=4,
    )
    known = ~blind
    filled = np.where(known, image, 0).astype(np.float64)
    while not known.all():
        weight = uniform_filter(known.astype(np.float64), 3, mode="constant")
        total = uniform_filter(np.where(known, filled, 0), 3, mode="constant")
        rim = ~known & (weight > 0.5 / 9)
        filled[rim] = total[rim] / weight[rim]
        known |= rim
    return filled.astype(np.float32)
