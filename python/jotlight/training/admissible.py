"""The set 𝒜 that the parameters must stay in, and the projection on it: equations (12) and (13)."""

import dataclasses
import math
from typing import Protocol

import numpy as np

from jotlight.networks.network import Network
from jotlight.training.parameters import Vector, split_vector


class AdmissibleSet(Protocol):
    """What :func:`jotlight.train` needs to know of a set, which has to be closed and convex.

    Gauss-Newton finds its steps in sets that bound each filter bank and each spline for themselves;
    for others take Adam. A checkpoint tells sets apart by their `repr`.
    """

    def project(self, network: Network, vector: Vector) -> Vector:
        """Give the point of the set that is nearest to the parameters of such a network."""


@dataclasses.dataclass(frozen=True)
class SafeSet:
    """Parameters with which nothing that a network computes can leave its range.

    For every possible input, the sums p and r stay in the domains of their splines and each output
    lies in [0, S]. The set is closed, convex and not empty:

    - the taps of each filter of the first layer are at least 0, and over a pixel's K bits they sum
      to the end of the domain of φ1 (K, for the paper's network);
    - the taps of each further filter sum to 1, and the sum of their absolute values is at most
      1 + 2ν, so that negative taps sum to -ν at most;
    - the coefficients of each spline but the last lie in the interval [l, m] for which
      [l - ν(m - l), m + ν(m - l)] is the domain of the next splines;
    - those of the last lie in [0, S];
    - where the network has one channel throughout, the coefficients of a spline do not fall, so
      that neither do the splines.

    Parameters
    ----------
    nu : float
        ν of 0 or more; 0 allows no negative taps.
    monotone : bool
        Whether the last of these conditions is made.

    Notes
    -----
    The paper does not say what its 𝒜 is. `docs/theory/learning.md` has the proof. That the sums of taps are
    fixed takes nothing away from filters whose sum is above 0, since the spline that follows can
    stretch its range instead.

    Examples
    --------
    >>> from jotlight import Sensor
    >>> from jotlight.training import parameter_vector
    >>> network = Network.initial(Sensor(oversampling=4))
    >>> vector = parameter_vector(network)
    >>> safe = SafeSet().project(network, vector)
    >>> np.abs(safe - vector).max() < 1e-6  # starts inside
    np.True_
    """

    nu: float = 0.5
    monotone: bool = True

    def __post_init__(self) -> None:
        if not (math.isfinite(self.nu) and self.nu >= 0):
            raise ValueError(f"nu: expected a number of 0 or more, got {self.nu}")

    def project(self, network: Network, vector: Vector) -> Vector:
        """Give the nearest parameters in the set; doing it twice changes nothing but roundings.

        Raises
        ------
        ValueError
            When 0 is not in the domain of the first splines, which then cannot be safe.
        """
        projected = np.array(vector, np.float64)
        domains = [
            (x.start, x.start + x.spacing * (x.spline_coefficients.shape[1] - 3))
            for x in network.layers
        ]
        if not domains[0][0] <= 0 < domains[0][1]:
            raise ValueError(
                f"network: expected a first spline that starts at 0, got the domain {domains[0]}"
            )
        for index, (filters, coefficients) in enumerate(split_vector(network, projected)):
            if index > 0:
                for taps in filters:
                    taps[...] = nearest_filter(taps.ravel(), self.nu).reshape(taps.shape)
            elif network.tied:
                # The one weight counts K times.
                filters[...] = domains[0][1] / network.sensor.bits_per_pixel
            else:
                for taps in filters:
                    taps[...] = nearest_weights(taps.ravel(), domains[0][1]).reshape(taps.shape)
            if self.monotone and all(len(layer.filters) == 1 for layer in network.layers):
                coefficients[0] = nearest_monotone(coefficients[0])
            if index + 1 < len(domains):
                low, high = domains[index + 1]
                room = self.nu * (high - low) / (1 + 2 * self.nu)
                coefficients[...] = coefficients.clip(low + room, high - room)
            else:
                coefficients[...] = coefficients.clip(0, network.sensor.max_intensity)
        return projected


def nearest_filter(taps: Vector, nu: float) -> Vector:
    """Nearest taps with sum 1 and sum of absolute values of at most 1 + 2ν.

    Where the second bound is met, the positive taps sum to 1 + ν and the negative ones to -ν, and
    each kind is the nearest on its own.

    Examples
    --------
    >>> nearest_filter(np.array([3.0, 1.0, -1.0]), nu=0.5)
    array([ 1.5,  0. , -0.5])
    """
    shifted = taps + (1 - taps.sum()) / taps.size
    if np.abs(shifted).sum() <= 1 + 2 * nu:
        return np.asarray(shifted)
    return nearest_weights(taps, 1 + nu) - nearest_weights(-taps, nu)


def nearest_weights(taps: Vector, total: float) -> Vector:
    """Nearest taps that are at least 0 and have this sum.

    Examples
    --------
    >>> nearest_weights(np.array([3.0, 1.0, -1.0]), total=2.0)
    array([2., 0., 0.])
    """
    # From the largest, so that large numbers do not swallow the total.
    below = taps - taps.max()
    descending = np.sort(below)[::-1]
    thresholds = (np.cumsum(descending) - total) / np.arange(1, taps.size + 1)
    # Σ max(x - t, 0) is the total for one t; the largest of these belongs to the values above it.
    return np.asarray(np.maximum(below - thresholds.max(), 0))


def nearest_monotone(coefficients: Vector) -> Vector:
    """Nearest coefficients of which none is less than the one before.

    Cut off at two bounds, they are the nearest with these bounds too.

    Examples
    --------
    >>> nearest_monotone(np.array([1.0, 3.0, 2.0]))
    array([1. , 2.5, 2.5])
    """
    from scipy.optimize import isotonic_regression

    return np.asarray(isotonic_regression(coefficients).x)
