"""Pixels of which nothing is known."""

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn


def fill_blind(
    image: npt.NDArray[np.float32], blind: npt.NDArray[np.bool_] | None
) -> npt.NDArray[np.float32]:
    """Fill blind pixels from their neighbours, from the rim of each hole inwards, and say so.

    A pixel becomes the mean of those of its 8 neighbours (2 in a signal) that are known; pixels
    filled in one round are known in the next.

    Raises
    ------
    ValueError
        When all pixels are blind.
    """
    if blind is None:
        return image
    if blind.all():
        raise ValueError("mask: expected at least one jot that is alive, got none")
    from scipy.ndimage import correlate

    warn(
        f"{blind.sum()} of {blind.size} pixels have no valid jot and were filled from their "
        "neighbours"
    )
    known = ~blind
    filled = np.where(known, image, 0).astype(np.float64)
    # No running sums as in uniform_filter: what they leave of the sums gone by may be below 0.
    window = np.ones((3,) * image.ndim)
    while not known.all():
        weight = correlate(known.astype(np.float64), window, mode="constant")
        total = correlate(np.where(known, filled, 0), window, mode="constant")
        rim = ~known & (weight > 0)
        filled[rim] = total[rim] / weight[rim]
        known |= rim
    return filled.astype(np.float32)
