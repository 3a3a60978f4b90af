"""Bounds of all values in a network, for any data. They show that no value overflows."""

from collections.abc import Sequence

import numpy as np

from jotlight.networks.graph import sources
from jotlight.networks.layer import Layer

MAX_VALUE = 1e30
"""Largest absolute value that a layer may have.

Intermediate values can be larger: 36,100 times in the Winograd transforms of convolutions, and 6
times in the polynomials of splines. They are far below the largest float32, 3.4e38, in any order of
summation.
"""

Interval = tuple[float, float]
"""The smallest and the largest value that the outputs of a layer may have."""


def output_bounds(layers: Sequence[Layer], max_input: float) -> list[Interval]:
    """Return bounds of the output of each layer, for all data.

    A filter multiplies the largest absolute value of its input by at most the sum of its absolute
    taps. The values of a spline lie between its smallest and its largest coefficient. The
    parameters of a K-conditioned layer are weighted means of its sets of parameters, so the extreme
    values of all sets bound them.

    Parameters
    ----------
    layers : sequence of Layer
        Layers that fit each other.
    max_input : float
        Largest value that the first layer reads: 1 for bits and fractions, K for counts.

    Raises
    ------
    ValueError
        When the values of a layer may exceed `MAX_VALUE`.

    Examples
    --------
    >>> mean = Layer(np.full((1, 1, 3, 3), 1 / 9), None)
    >>> sign = Layer(np.ones((1, 1, 1, 1)), np.array([[-1.0, -1.0, 2.0, 2.0]]))
    >>> [(round(low, 6), round(high, 6)) for low, high in output_bounds([mean, sign], 4.0)]
    [(-4.0, 4.0), (-1.0, 2.0)]
    """
    bounds: list[Interval] = []
    for index, (layer, source) in enumerate(zip(layers, sources(layers), strict=True)):
        largest = _largest_sum(layer) * (max(map(abs, bounds[source])) if index else max_input)
        if layer.skip is not None:
            largest += max(map(abs, bounds[layer.skip]))
        interval = -largest, largest
        if layer.coefficients is not None:
            interval = float(layer.coefficients.min()), float(layer.coefficients.max())
        largest = max(largest, *map(abs, interval))
        if largest > MAX_VALUE:
            raise ValueError(
                f"layers: expected taps and coefficients that keep the values of layer {index} "
                f"within {MAX_VALUE:g}, got values of up to {largest:.3g}; train the network again"
            )
        bounds.append(interval)
    return bounds


def _largest_sum(layer: Layer) -> float:
    """Return the largest sum of the absolute taps of a filter."""
    sums = np.abs(layer.filters).sum((-3, -2, -1), dtype=np.float64)
    return float(sums.max())
