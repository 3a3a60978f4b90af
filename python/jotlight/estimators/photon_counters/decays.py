"""Exponential decays: the most likely rate of each pixel, from the ones of its gates."""

import dataclasses
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.sensing.parameters.response import inverse_detection_probability
from jotlight.underflow import underflows_to_0

_MAX_STEPS = 30
"""Maximum number of steps. A likelihood without a maximum at a finite rate reaches it."""

_MAX_HALVINGS = 20
"""Maximum number of times that a step is halved, until the likelihood does not decrease."""

_MAX_STEP = 3.0
"""Largest change of a value x (a or r) in a step, in multiples of 1 + |x|."""

_AMPLITUDE_STEPS = 2
"""Number of steps to the most likely amplitude of each rate at which a search may begin."""

TOLERANCE = 1e-8
"""A search ends when steps are smaller, in multiples of 1 + |x|. Smaller rates count as 0."""


@dataclasses.dataclass(frozen=True)
class Gates:
    """The ones of gates, and their likelihood for an exponential decay.

    The gate at the time t expects λ = exp(a - r t) + d detections per reading. Its ones are
    binomial with the probability 1 - exp(-λ). A point holds a and r of each pixel, (2, P).

    Parameters
    ----------
    ones, readings : ndarray of float64, shape (G, P)
        L and n. Without dark counts, and with many readings, L may be negative.
    times : ndarray of float64, shape (G,)
        From 0 to 1.
    dark_counts : ndarray of float64, shape (G, P)
        d, per reading.
    """

    ones: Array
    readings: Array
    times: Array
    dark_counts: Array

    def at(self, places: npt.NDArray[np.integer]) -> Self:
        """Return the gates of some pixels."""
        ones, readings, dark = self.ones, self.readings, self.dark_counts
        return type(self)(ones[:, places], readings[:, places], self.times, dark[:, places])

    def have_decay(self) -> npt.NDArray[np.bool_]:
        """Return which pixels may have a most likely decay, (P,).

        Two gates need ones. A decay has light in the first gate and in later ones, so negative ones
        must not exceed the others: neither in their sum, nor after the first gate with readings.
        """
        first = self.times[np.argmax(self.readings > 0, axis=0)]
        later = (self.times[:, None] - first) * self.ones
        has_two = np.count_nonzero(self.ones, axis=0) > 1
        return np.asarray(has_two & (self.ones.sum(axis=0) > 0) & (later.sum(axis=0) > 0))

    @underflows_to_0
    def light(self, point: Array) -> Array:
        """Return exp(a - r t), (G, P)."""
        exponent = point[0] - np.multiply.outer(self.times, point[1])
        return np.asarray(np.exp(np.clip(exponent, -600, 600)))

    @underflows_to_0
    def first_point(self) -> Array:
        """Return where the search begins: the most likely one of some rates, (2, P)."""
        fraction = self.ones / (self.readings + 1)
        light = inverse_detection_probability(1, fraction, 1 - fraction) - self.dark_counts
        # Noise of the dark counts must not hide all light.
        total = np.maximum(light.sum(axis=0), 0.1 * np.abs(light + self.dark_counts).sum(axis=0))
        fastest = 4 / np.diff(self.times).min()
        points = [
            np.stack([np.log(total / np.exp(-rate * self.times).sum()), np.full(total.shape, rate)])
            for rate in [0.0, *2.0 ** np.arange(-1, np.ceil(np.log2(fastest)) + 1)]
        ]
        if self.dark_counts.any():  # The likelihood may have several maxima.
            points += [self.with_likely_amplitude(point) for point in points]
        best = np.argmax([self.log_likelihood(point) for point in points], axis=0)
        return np.asarray(np.take_along_axis(np.stack(points), best[None, None], axis=0)[0])

    def with_likely_amplitude(self, point: Array) -> Array:
        """Return a point whose a is about the most likely one at its r, by Fisher scoring."""
        point = point.copy()
        for _ in range(_AMPLITUDE_STEPS):
            _, score, weights = self.derivatives(self.light(point))
            slope, information = score.sum(axis=0), weights.sum(axis=0)
            step = np.divide(slope, information, out=np.zeros_like(slope), where=information > 0)
            point[0] += np.clip(step, -_MAX_STEP, _MAX_STEP)
        return point

    @underflows_to_0
    def derivatives(self, light: Array) -> tuple[Array, Array, Array]:
        """Return the odds of a 0, and the slope and the information about log light, (G, P)."""
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            odds = 1 / np.expm1(light + self.dark_counts)
            score = light * (self.ones * odds - (self.readings - self.ones))
            return odds, score, light**2 * self.readings * odds

    def log_likelihood(self, point: Array) -> Array:
        """Return the logarithm of the likelihood without its constant terms, (P,)."""
        rate = self.light(point) + self.dark_counts
        zeros = self.readings - self.ones
        return np.asarray((self.ones * np.log(-np.expm1(-rate)) - zeros * rate).sum(axis=0))

    def step(self, point: Array) -> Array:
        """Return a step of Newton's method, (2, P); NaN where the gates determine none.

        Where the likelihood is not concave, the Fisher information replaces its curvature.
        """
        light, places = self.light(point), np.stack([self.times**0, -self.times])
        odds, score, weights = self.derivatives(light)
        squares = np.stack([places[0], places[1], places[1] ** 2])
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            slope = places @ score
            curvature = squares @ (light**2 * self.ones * odds * (1 + odds) - score)
            information = squares @ weights
            is_concave = (curvature[0] > 0) & (curvature[0] * curvature[2] > curvature[1] ** 2)
            first, mixed, last = np.where(is_concave, curvature, information)
            step = np.stack(
                [last * slope[0] - mixed * slope[1], first * slope[1] - mixed * slope[0]]
            )
            step /= first * last - mixed**2
            shares = _MAX_STEP * (1 + np.abs(point)) / np.abs(step)
            return np.asarray(step * np.minimum(1, shares.min(axis=0)))

    def shortened(self, point: Array, step: Array) -> Array:
        """Return the step, halved until it does not decrease the likelihood."""
        before, step = self.log_likelihood(point), step.copy()
        for _ in range(_MAX_HALVINGS):
            is_worse = self.log_likelihood(point + step) < before - 1e-9 * np.abs(before)
            if not is_worse.any():
                break
            step[:, is_worse] /= 2
        return step


def decay_rates(gates: Gates) -> Array:
    """Return the most likely rate r of the decay of each pixel, or NaN.

    Without dark counts, the logarithm of the likelihood is concave in a and r, so its maximum
    is the only one.

    Returns
    -------
    ndarray of float64, shape (P,)
        r, of either sign; NaN where the ones have no decay, or the search does not end.

    Examples
    --------
    >>> ones = 1e9 * -np.expm1(-np.exp([[0.0], [-1.0], [-2.0]]))  # exp(-2 t)
    >>> gates = Gates(ones, np.full((3, 1), 1e9), np.array([0, 0.5, 1]), np.zeros((3, 1)))
    >>> decay_rates(gates).round(6).tolist()
    [2.0]
    """
    rates = np.full(gates.ones.shape[1], np.nan)
    places = np.flatnonzero(gates.have_decay())
    gates = gates.at(places)
    point = gates.first_point()
    for _ in range(_MAX_STEPS):
        step = gates.shortened(point, gates.step(point))
        point = point + step
        is_found = (np.abs(step) < TOLERANCE * (1 + np.abs(point))).all(axis=0)
        rates[places[is_found]] = point[1, is_found]
        remain = np.flatnonzero(np.isfinite(step).all(axis=0) & ~is_found)
        places, point, gates = places[remain], point[:, remain], gates.at(remain)
        if not places.size:
            break
    return rates
