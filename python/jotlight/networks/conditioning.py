"""K-conditioned parameters: M sets, interpolated by cubic B-splines over log2 K."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.networks.layer import Layer

MIN_SETS = 4
"""Smallest number M of parameter sets, because four cubic B-splines overlap between two knots."""


def conditioning_weights(
    trials: float, trials_range: tuple[float, float], number: int
) -> npt.NDArray[np.float64]:
    """Return the weight of each parameter set for K = `trials`.

    The weights are the values of `number` cubic B-splines at log2 K. Their knots cover the range.

    Parameters
    ----------
    trials : float
        K, in `trials_range`.
    trials_range : (float, float)
        Smallest and largest K of the network.
    number : int
        M, at least 4.

    Returns
    -------
    ndarray, shape (M,)
        Weights of 0 or more with sum 1; at most four are not 0.

    Raises
    ------
    ValueError
        For a K out of the range, where the splines are not defined.

    Examples
    --------
    >>> conditioning_weights(16, (1, 256), 5).round(3).tolist()
    [0.0, 0.167, 0.667, 0.167, 0.0]
    """
    return engine.conditioning_weights(trials, trials_range, number)


def count_sets(layers: Sequence[Layer]) -> int:
    """Return the number M of parameter sets of the layers, or 4 if no layer has sets.

    Raises
    ------
    ValueError
        When layers have different numbers of sets, or fewer than 4.
    """
    found: set[int] = set().union(*(layer.set_counts for layer in layers))
    if len(found) > 1 or min(found, default=MIN_SETS) < MIN_SETS:
        raise ValueError(
            f"layers: expected the same number of parameter sets in all layers, {MIN_SETS} or "
            f"more, got {sorted(found)}"
        )
    return max(found, default=MIN_SETS)
