"""The planes that a color network reads: classical colors, and what pixels behind filters see.

A color network improves an estimate of the colors by a classical method. It takes any filters,
which may repeat or be a map of all pixels, and also color channels, where each pixel has three
counts. So its input does not depend on the pattern. For each pixel it states

- z = arcsin √p of red, green, and blue by the classical method, in three planes;
- by how much z = arcsin √(L/K) of the bits deviates from what this estimate predicts behind the
  filter, in four planes: red, green, blue, and white light. The noise of z has the standard
  deviation 1/(2 √K) at every exposure;
- how much the filter passes of each, in four planes. A pixel without a valid bit has zeros.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.networks.planes.planes_layers import CENTER
from jotlight.sensing.parameters.binomial import arcsin_root

PLANES = 11
"""Number of planes."""

DEVIATIONS = slice(0, 4)
"""The planes of the deviations of the bits from the classical estimate."""

START = slice(8, 11)
"""The planes of the classical estimate."""


class Filtered(NamedTuple):
    """What the pixels behind one color filter saw."""

    transmission: Array
    """The shares of red, green, and blue that the filter passes, (3,)."""
    fraction: npt.NDArray[np.floating]
    """L/K, (H, W)."""
    weight: npt.NDArray[np.floating]
    """1 at the pixels with this filter, less where they have fewer valid bits than usual, and 0 at
    other pixels, (H, W)."""


def color_planes(
    filters: Sequence[Filtered],
    start: npt.NDArray[np.floating],
    to_probability: Callable[[Array], Array],
) -> Image:
    """Return the planes of an image, (11, H, W).

    Parameters
    ----------
    filters : sequence of Filtered
        What the pixels behind each filter saw.
    start : ndarray of float, shape (3, H, W)
        Red, green, and blue by the classical method.
    to_probability : callable
        The response of the sensor without filters: P(b = 1) of an intensity.

    Examples
    --------
    >>> channel = np.full((4, 6), 0.25)
    >>> every = np.ones((4, 6))
    >>> filters = [Filtered(share, channel, every) for share in np.eye(3)]
    >>> planes = color_planes(filters, np.full((3, 4, 6), 0.25), lambda c: c)
    >>> planes[3:, 0, 0].round(3)
    array([ 0.   ,  1.   ,  1.   ,  1.   ,  0.   , -0.262, -0.262, -0.262],
          dtype=float32)
    """
    planes = np.zeros((PLANES, *start.shape[1:]), np.float32)
    colors = np.asarray(start, np.float64)
    for transmission, fraction, weight in filters:
        expected = to_probability(np.tensordot(transmission, colors, 1))
        deviation = weight * (arcsin_root(fraction) - arcsin_root(expected))
        for plane, share in enumerate(_shares(transmission)):
            if share:
                planes[plane] += share * deviation
                planes[4 + plane] += share * weight
    planes[START] = arcsin_root(to_probability(colors)) - CENTER
    return planes


def _shares(transmission: Array) -> Array:
    """Return the shares of red, green, blue, and white light, (4,).

    White is what all three have in common.
    """
    white = transmission.min()
    return np.append(transmission - white, white)
