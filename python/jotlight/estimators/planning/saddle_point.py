"""The error of the estimate of equal readings where it is not much smaller than the light.

The log-likelihood is concave. So the most likely light exceeds t exactly if the sum of the scores
at t is above 0, where scores are the derivatives of the log-likelihoods of readings. Lugannani and
Rice (1980) approximate the probability of this by the saddle point of the cumulants of a score.
"""

import dataclasses
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.planning.planned_estimates import PlannedGroup

_LIGHTS = 160
"""Number of levels of light t."""

_DARKEST = 1e-3
"""The darkest of these levels, relative to the true light."""

_MIN_PROBABILITY = 1e-15
"""Probability of a reading that does not matter."""

_MAX_STEPS = 60
"""Maximum number of steps to a saddle point."""

_TOLERANCE = 1e-10
"""Accuracy of a saddle point, relative to the standard deviation of a score."""

_NEAR = 1e-2
"""Number of standard deviations from the mean below which the sum is taken as normal."""


@dataclasses.dataclass(frozen=True, eq=False)
class SaddlePoints:
    """The saddle points of the cumulants K(u) of a score at each level of light, where K' = 0.

    They do not depend on the number of readings.
    """

    level: float
    """The true light."""
    lights: Array
    """The levels t, ascending."""
    places: Array
    """u at the saddle points. It is infinite where all scores are below 0 or all are above."""
    cumulants: Array
    """K at the saddle points."""
    curvatures: Array
    """K'' at the saddle points."""

    @classmethod
    def of(cls, group: PlannedGroup, level: float, top: float) -> Self:
        """Return the saddle points of the readings of a level of light, above 0.

        Parameters
        ----------
        group : PlannedGroup
            The readings.
        level : float
            The true light.
        top : float
            The largest light that estimates are compared with.
        """
        _, readings, p = group.probabilities(np.array([level]))
        occur = p > _MIN_PROBABILITY
        lights = np.geomspace(_DARKEST * level, max(top, level), _LIGHTS)
        rows, columns = np.repeat(lights, occur.sum()), np.tile(readings[occur], lights.size)
        scores = group.scores(columns, rows).reshape(lights.size, -1)
        return cls(level, lights, *_saddle_points(np.log(p[occur]), scores))

    def bias_and_mse(self, number: int, max_light: float) -> tuple[float, float]:
        """Return the bias and the mean square error of estimates up to `max_light`.

        They are integrals of the probability that the estimate from a number of readings exceeds t.

        Examples
        --------
        >>> from jotlight.sensing.parameters.response import JotResponse
        >>> bits = PlannedGroup(JotResponse(1, 0.0, 1), 1.0, 0.0)
        >>> bias, mse = SaddlePoints.of(bits, 0.3, 9.0).bias_and_mse(100, 9.0)
        >>> round(mse**0.5, 3)  # the bound is √((e^0.3 - 1)/100) = 0.059
        0.059
        """
        exceeds = self.exceedance(number)
        lights = np.minimum(np.concatenate([[0.0], self.lights]), max_light)
        exceeds = np.concatenate([exceeds[:1], exceeds])
        mean = float(np.trapezoid(exceeds, lights))
        square = float(np.trapezoid(2 * (lights - self.level) * exceeds, lights))
        return mean - self.level, square + self.level**2

    def exceedance(self, number: int) -> Array:
        """Return the probability that the estimate exceeds each level of light."""
        from scipy.special import ndtr

        u = self.places
        known = np.isfinite(u)
        own = np.where(known, u, 1.0)
        deviation = np.sign(own) * np.sqrt(np.maximum(-2 * number * self.cumulants, 0))
        near = np.abs(deviation) < _NEAR
        other = np.where(near, 1.0, own * np.sqrt(number * self.curvatures))
        density = np.exp(-(deviation**2) / 2) / np.sqrt(2 * np.pi)
        skewness = 1 / other - 1 / np.where(near, 1.0, deviation)
        tail = ndtr(-deviation) + np.where(near, 0.0, density * skewness)
        return np.where(known, np.clip(tail, 0, 1), u < 0)


def _saddle_points(logarithms: Array, scores: Array) -> tuple[Array, Array, Array]:
    """Return u, K, and K'' at the saddle points of scores (T, R) with log-probabilities (R,).

    Newton's method solves K'(u) = 0, with bisection where a step leaves the bounds.
    """
    rises, falls = (scores > 0).any(axis=1), (scores < 0).any(axis=1)
    known = rises & falls
    places = np.where(rises, -np.inf, np.inf)
    cumulants, curvatures = np.zeros(len(scores)), np.ones(len(scores))
    scores = scores[known]
    u = np.zeros(len(scores))
    low, high = np.full(len(scores), -np.inf), np.full(len(scores), np.inf)
    deviation = np.sqrt((np.exp(logarithms) * scores**2).sum(axis=1))
    for _ in range(_MAX_STEPS):
        value, slope, curvature = _cumulants(logarithms, scores, u)
        if (np.abs(slope) <= _TOLERANCE * deviation).all():
            break
        low, high = np.where(slope < 0, u, low), np.where(slope > 0, u, high)
        # A step is at most one standard deviation beyond twice the last place.
        limit = np.abs(u) + 1 / deviation
        step = np.clip(-slope / np.maximum(curvature, 1e-300), -limit, limit)
        middle = np.where(np.isfinite(low) & np.isfinite(high), (low + high) / 2, u + step)
        inside = (low < u + step) & (u + step < high)
        u = np.where(inside, u + step, middle)
    places[known], cumulants[known], curvatures[known] = u, value, curvature
    return places, cumulants, curvatures


def _cumulants(
    logarithms: Array, scores: Array, u: npt.NDArray[np.float64]
) -> tuple[Array, Array, Array]:
    """Return K, K', and K'' at u of each level of light."""
    exponents = logarithms + u[:, None] * scores
    largest = exponents.max(axis=1)
    weights = np.exp(exponents - largest[:, None])
    total = weights.sum(axis=1)
    weights /= total[:, None]
    mean = (weights * scores).sum(axis=1)
    variance = (weights * (scores - mean[:, None]) ** 2).sum(axis=1)
    return largest + np.log(total), mean, variance
