"""Networks conditioned on K: sets of parameters, weighed by cubic B-splines at log2 K."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.networks.layer import Layer
from jotlight.networks.splines import CUBIC_BASIS


def conditioning_weights(
    bits: float, between: tuple[float, float], number: int
) -> npt.NDArray[np.float64]:
    """Give how much of each of so many sets of parameters a network has that is told K = `bits`.

    The shares are the values of cubic B-splines at log2 K, over the range of K.

    Examples
    --------
    >>> conditioning_weights(16, (1, 256), 5).round(3).tolist()
    [0.0, 0.167, 0.667, 0.167, 0.0]
    """
    low, high = (math.log2(x) for x in between)
    place = (math.log2(bits) - low) / (high - low) * (number - 3)
    first = min(max(math.floor(place), 0), number - 4)
    through = place - first
    cubics = [(((d * through + c) * through + b) * through + a) / 6 for a, b, c, d in CUBIC_BASIS]
    return np.array([0.0] * first + cubics + [0.0] * (number - 4 - first))


def count_sets(layers: Sequence[Layer]) -> int:
    """Give M of layers that have sets of parameters, and the least that there can be for others.

    Raises
    ------
    ValueError
        When they have different numbers.
    """
    found: set[int] = set().union(*(layer.set_counts for layer in layers))
    if len(found) > 1 or min(found, default=4) < 4:
        raise ValueError(
            f"layers: expected the same number of sets of parameters in all, 4 or more, got {found}"
        )
    return max(found, default=4)
