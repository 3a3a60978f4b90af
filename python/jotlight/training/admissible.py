"""The admissible set 𝒜 of parameters, and the projection onto it: equations (12) and (13)."""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol

import numpy as np

from jotlight.array_types import Array
from jotlight.checks import real_number, shown
from jotlight.networks.network import Network
from jotlight.training.parameters import split_vector


class AdmissibleSet(Protocol):
    """A closed and convex set of parameters for :func:`jotlight.train`.

    Gauss-Newton needs a set that bounds each filter bank and each spline separately; for other
    sets, use Adam. The `repr` of a set identifies it in a checkpoint.
    """

    def project(self, network: Network, vector: Array) -> Array:
        """Return the point of the set that is nearest to `vector`, parameters of the network."""


@dataclasses.dataclass(frozen=True)
class SafeSet:
    """The set of parameters that keep every value in the network in its range, for every input.

    The sums p and r stay in the domains of their splines, and each output lies in [0, S]. The set
    is closed, convex, and not empty. Its conditions are:

    - The taps of each filter of the first layer are at least 0. Over the K bits of a pixel, they
      sum to the end of the domain of φ1, which is K for the paper's network.
    - The taps of each other filter sum to 1, and their absolute values sum to at most 1 + 2ν. So
      the negative taps sum to -ν or more.
    - The coefficients of each spline but the last lie in the interval [l, m] for which
      [l - ν(m - l), m + ν(m - l)] is the domain of the next splines.
    - The coefficients of the last spline lie in [0, S].
    - If every layer has one channel, the coefficients of each spline never decrease, so each
      spline is monotone.

    Parameters
    ----------
    nu : float
        ν, at least 0; 0 allows no negative taps.
    monotone : bool
        Whether the set has the last condition.

    Raises
    ------
    ValueError
        When ν is negative or not finite.

    Notes
    -----
    Differs from the paper: the paper does not define its 𝒜. `docs/theory/learning.md` proves that
    this set has the stated properties. A fixed sum of taps excludes no filter with a positive sum,
    because stretching the following spline has the effect of scaling the filter.

    Examples
    --------
    >>> from jotlight.training import parameter_vector
    >>> network = jl.Network.initial(jl.Sensor(oversampling=4))
    >>> vector = parameter_vector(network)
    >>> safe = SafeSet().project(network, vector)
    >>> np.abs(safe - vector).max() < 1e-6  # the network starts inside the set
    np.True_
    """

    nu: float = 0.5
    monotone: bool = True

    def __post_init__(self) -> None:
        nu = float(real_number(self.nu))
        if not (math.isfinite(nu) and nu >= 0):
            raise ValueError(f"nu: expected a number of 0 or more, got {shown(self.nu)}")
        object.__setattr__(self, "nu", nu)
        if not isinstance(self.monotone, bool | np.bool_):
            raise TypeError(f"monotone: expected True or False, got {shown(self.monotone)}")
        object.__setattr__(self, "monotone", bool(self.monotone))

    def project(self, network: Network, vector: Array) -> Array:
        """Return the nearest parameters in the set. The projection is idempotent up to rounding.

        Raises
        ------
        ValueError
            When 0 is not in the domain of the first splines: then the set is empty.
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
                # The one weight applies to K bits.
                filters[...] = domains[0][1] / network.sensor.trials
            else:
                for taps in filters:
                    taps[...] = nearest_weights(taps.ravel(), domains[0][1]).reshape(taps.shape)
            if self.monotone and all(len(layer.filters) == 1 for layer in network.layers):
                coefficients[0] = nearest_monotone(coefficients[0])
            if index + 1 < len(domains):
                low, high = domains[index + 1]
                margin = self.nu * (high - low) / (1 + 2 * self.nu)
                coefficients[...] = coefficients.clip(low + margin, high - margin)
            else:
                coefficients[...] = coefficients.clip(0, network.sensor.max_intensity)
        return projected


def nearest_filter(taps: Array, nu: float) -> Array:
    """Return the nearest taps with sum 1 whose absolute values sum to at most 1 + 2ν.

    If the absolute values reach their bound, the positive taps sum to 1 + ν and the negative taps
    to -ν. Then each part is projected separately.

    Examples
    --------
    >>> nearest_filter(np.array([3.0, 1.0, -1.0]), nu=0.5)
    array([ 1.5,  0. , -0.5])
    """
    shifted = taps + (1 - taps.sum()) / taps.size
    if np.abs(shifted).sum() <= 1 + 2 * nu:
        return np.asarray(shifted)
    return nearest_weights(taps, 1 + nu) - nearest_weights(-taps, nu)


def nearest_weights(taps: Array, total: float) -> Array:
    """Return the nearest taps that are at least 0 and sum to `total`.

    Examples
    --------
    >>> nearest_weights(np.array([3.0, 1.0, -1.0]), total=2.0)
    array([2., 0., 0.])
    """
    # Subtract the largest tap. Otherwise, the total could vanish in the rounding of large taps.
    below = taps - taps.max()
    descending = np.sort(below)[::-1]
    thresholds = (np.cumsum(descending) - total) / np.arange(1, taps.size + 1)
    # The result is max(x - t, 0) with the sum `total`. Each possible number of positive taps has a
    # candidate for t; the largest candidate is t.
    return np.asarray(np.maximum(below - thresholds.max(), 0))


def nearest_monotone(coefficients: Array) -> Array:
    """Return the nearest coefficients that never decrease.

    After clipping to two bounds, they are also the nearest ones within these bounds.

    Examples
    --------
    >>> nearest_monotone(np.array([1.0, 3.0, 2.0]))
    array([1. , 2.5, 2.5])
    """
    from scipy.optimize import isotonic_regression

    return np.asarray(isotonic_regression(coefficients).x)
