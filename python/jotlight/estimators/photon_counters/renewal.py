"""How many detections a pixel has that is blind for a dead time after each of them."""

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import AnyIntegers, Array
from jotlight.interrupts import interruptible
from jotlight.underflow import underflows_to_0

_DEVIATIONS = 9
"""Sums over n contain numbers up to this many standard deviations from the mean."""

_MIN_WIDTH = 30
"""Sums contain this many more numbers on both sides, for small means and near saturation."""

_MAX_TERMS = 1 << 18
"""Maximum number of terms of sums that are computed at a time."""

_MIN_REST = 1e-9
"""Shorter remaining times are rounding errors of 0. It is a hundredth of the shortest dead time."""

_TINY = 1e-290
"""Smaller probabilities underflow, or have few digits."""


@dataclasses.dataclass(frozen=True)
class Renewal:
    """The number N of detections in the exposure time, at a rate r of detections per this time.

    Notes
    -----
    P(N ≥ n) = P(n, r u(n)), the regularized lower incomplete gamma function, with the remaining
    time u(n) = 1 - (n - 1) τ. N approaches a normal distribution with the mean r/(1 + r τ) and the
    variance r/(1 + r τ)³.

    Parameters
    ----------
    dead_time : float
        τ, as a fraction of the exposure time.

    Examples
    --------
    >>> renewal = Renewal(0.3)
    >>> renewal.probabilities(np.arange(6), np.array(2.0)).round(4).tolist()
    [0.1353, 0.4565, 0.3607, 0.0474, 0.0001]
    """

    dead_time: float

    @property
    def max_count(self) -> int:
        """The largest number of detections in an exposure."""
        return int(np.ceil((1 - _MIN_REST) / self.dead_time))

    def rest(self, count: npt.ArrayLike) -> Array:
        """Return u(n): the exposure without the dead times before the last of n detections."""
        rest = 1 - (np.asarray(count, np.float64) - 1) * self.dead_time
        return np.asarray(np.where(rest > _MIN_REST, rest, 0.0))

    def at_least(self, count: AnyIntegers, rate: Array) -> Array:
        """Return P(N ≥ n)."""
        tails, is_upper = self._tails(count, rate)
        return np.where(is_upper, tails, 1 - tails)

    def _tails(self, count: AnyIntegers, rate: Array) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Return P(N ≥ n) or P(N < n), about the smaller one, and whether it is P(N ≥ n)."""
        from scipy.special import gammainc, gammaincc

        n, rates = np.broadcast_arrays(count, rate)
        argument = rates * self.rest(n)
        is_upper, tails = argument < n, np.zeros(n.shape)
        for part, tail in ((is_upper, gammainc), (~is_upper & (n > 0), gammaincc)):
            tails[part] = interruptible(tail)(n[part], argument[part])
        return tails, is_upper

    @underflows_to_0
    def probabilities(self, count: AnyIntegers, rate: Array) -> Array:
        """Return P(N = n) for all but the last of successive numbers in the last axis."""
        tails, is_upper = self._tails(count, rate)
        own, following = tails[..., :-1], tails[..., 1:]
        # The difference of two numbers close to 1 would lose digits.
        same = np.where(is_upper[..., :-1], own - following, following - own)
        return np.where(is_upper[..., :-1] == is_upper[..., 1:], same, 1 - own - following)

    @underflows_to_0
    def slope(self, count: AnyIntegers, rate: Array) -> Array:
        """Return the derivative of P(N ≥ n) by the rate: u(n) times a Poisson probability."""
        from scipy.special import gammaln, xlogy

        rest, earlier = self.rest(count), np.maximum(count - 1, 0)
        logarithm = xlogy(earlier, rate * rest) - rate * rest - gammaln(earlier + 1)
        return np.asarray(np.where((count > 0) & (rest > 0), rest * np.exp(logarithm), 0.0))

    @underflows_to_0
    def score(self, count: AnyIntegers, rate: Array) -> Array:
        """Return the derivative of log P(N = n) by the rate."""
        n, rates = np.broadcast_arrays(count, rate)
        slope = self.slope(n, rates) - self.slope(n + 1, rates)
        probability = self.probabilities(n[..., None] + np.arange(2), rates[..., None])[..., 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            # Where the probability underflows, take that of n detections and a last dead time that
            # ends within the exposure.
            steep = n / rates - self.rest(n + 1)
            return np.asarray(np.where(probability > _TINY, slope / probability, steep))

    @underflows_to_0
    def mean(self, rate: Array) -> Array:
        """Return the expected number of detections: the sum of P(N ≥ n) over n from 1."""

        def total(count: AnyIntegers, rates: Array) -> Array:
            return np.asarray(count[:, 0] + self.at_least(count[:, 1:], rates).sum(axis=1))

        return self._sum(rate, total)

    @underflows_to_0
    def information(self, rate: Array) -> Array:
        """Return the Fisher information of the number about the rate."""

        def total(count: AnyIntegers, rates: Array) -> Array:
            slope = -np.diff(self.slope(count, rates), axis=1)
            probability = self.probabilities(count, rates)
            terms, usable = np.zeros(slope.shape), probability > _TINY
            np.divide(slope**2, probability, out=terms, where=usable)
            return np.asarray(terms.sum(axis=1))

        return self._sum(rate, total)

    def _sum(self, rate: Array, total: Callable[[AnyIntegers, Array], Array]) -> Array:
        """Return a sum over the probable numbers of detections at each rate.

        `total` returns the sums, (P,), for successive numbers, (P, M), and rates, (P, 1). Numbers
        before the first and from the last on are improbable.
        """
        rates, places = np.unique(rate, return_inverse=True)
        loss = 1 + rates * self.dead_time
        width = _DEVIATIONS * np.sqrt(rates / loss**3) + _MIN_WIDTH
        first = np.maximum(np.floor(rates / loss - width), 0).astype(np.int64)
        stop = np.minimum(np.ceil(rates / loss + width), self.max_count + 1).astype(np.int64)
        number = int((stop - first).max(initial=0)) + 1
        size = max(1, _MAX_TERMS // number)
        parts = [slice(at, at + size) for at in range(0, len(rates), size)]
        sums = [total(first[part, None] + np.arange(number), rates[part, None]) for part in parts]
        return np.concatenate([np.zeros(0), *sums])[places].reshape(rate.shape)
