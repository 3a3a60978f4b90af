"""The distribution of the dark counts of ordinary jots, with a fit that ignores hot jots."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.underflow import underflows_to_0

_MAX_QUANTILE = 0.7
"""The fit ignores counts above this quantile. Nearly all of them may belong to hot jots."""

_MIN_QUANTILE = 0.02
"""The fit ignores counts below this quantile. They may belong to dead jots."""

_MIN_CUT = 2
"""Minimum range of the counts in the fit. Fewer than three values do not determine a spread."""

_MAX_SPREAD = 10.0
"""Maximum spread. Nearly all jots then report 0 in all frames, or 1 in all frames."""

_MAX_MEAN = 3
"""Maximum mean of the distribution, in multiples of the largest count in the fit.

If the histogram increases up to this count, the likelihood has no maximum at a finite mean.
"""

_MAX_TERMS = 1 << 16
"""Maximum number of counts whose probabilities are all computed."""

_NEAR = 2048
"""Distance, in counts, from the mode and from both ends up to which all counts are used.

Of longer ranges, counts at a larger distance x are used in steps of about x / 2048. Relative to the
width of a peak, the steps are short wherever its probability is not negligible.
"""


@dataclasses.dataclass(frozen=True)
class Bulk:
    """The beta-binomial distribution of the counts of ordinary jots.

    The count of a jot is binomial. Its probability varies over the jots by a beta distribution.

    Parameters
    ----------
    frames : int
        T, the number of frames.
    mean : float
        Mean probability that a jot reports 1 in a frame.
    spread : float
        1/(a + b) for the parameters a and b of the beta distribution. Near 0, all jots have the
        same probability.

    Examples
    --------
    >>> Bulk(1000, 0.01, 1e-9).threshold(1e-4)  # 10 counts on average, Poisson
    25
    >>> Bulk(1000, 0.01, 1e-2).threshold(1e-4)  # the rates vary by their mean
    94
    """

    frames: int
    mean: float
    spread: float

    def log_probability(self, counts: npt.ArrayLike) -> Array:
        """Return the logarithm of the probability of each count."""
        from scipy.special import betaln

        k, n = np.asarray(counts, np.float64), float(self.frames)
        a, b = self.mean / self.spread, (1 - self.mean) / self.spread
        log_binomial = -betaln(k + 1, n - k + 1) - np.log1p(n)
        return np.asarray(log_binomial + betaln(k + a, n - k + b) - betaln(a, b))

    def shrunk_probabilities(self, counts: npt.ArrayLike) -> Array:
        """Return the probabilities of a one of ordinary jots, by their counts.

        They are (L + m/spread)/(T + 1/spread), the mean of the beta distribution after the frames
        of the jot. Its mean m before is that of the counts, so the sum of the counts stays.

        Examples
        --------
        >>> Bulk(1000, 0.01, 1e-9).shrunk_probabilities([0, 10, 20]).round(4).tolist()  # all alike
        [0.01, 0.01, 0.01]
        >>> Bulk(1000, 0.01, 1e-3).shrunk_probabilities([0, 10, 20]).round(4).tolist()
        [0.005, 0.01, 0.015]
        """
        ones = np.asarray(counts, np.float64)
        mean = ones.mean() / self.frames
        return np.asarray((ones * self.spread + mean) / (self.frames * self.spread + 1))

    @underflows_to_0
    def threshold(self, false_positive_rate: float) -> int:
        """Return the smallest count whose tail probability is at most the rate, or T + 1.

        Examples
        --------
        >>> Bulk(10**6, 1e-6, 1e-9).threshold(1e-4)  # 1 count on average
        7
        """
        counts, tail = self._tail_probabilities()
        place = int(np.argmax(np.append(tail, 0.0) <= false_positive_rate))
        first = counts[place - 1] if place > 0 else 0
        stop, rest = (counts[place], tail[place]) if place < len(counts) else (self.frames + 1, 0.0)
        between = np.arange(first, stop)
        tails = rest + np.cumsum(np.exp(self.log_probability(between))[::-1])[::-1]
        reached = np.append(tails, rest) <= false_positive_rate
        return int(np.append(between, stop)[np.argmax(reached)])

    @underflows_to_0
    def tail_probability(self, ones: int) -> float:
        """Return the probability that an ordinary jot has this count or a larger one.

        Examples
        --------
        >>> round(Bulk(4, 0.2, 1e-9).tail_probability(4), 6)  # 0.2 ** 4
        0.0016
        """
        counts, tail = self._tail_probabilities()
        place = np.searchsorted(counts, ones)
        if place == len(counts):
            return 0.0
        between = np.arange(max(ones, 0), counts[place])
        return float(tail[place] + np.exp(self.log_probability(between)).sum())

    @underflows_to_0
    def log_mass(self, low: int, top: int) -> float:
        """Return the logarithm of the probability of the counts from `low` to `top`.

        Examples
        --------
        >>> round(float(np.exp(Bulk(4, 0.2, 1e-9).log_mass(3, 4))), 6)  # four ones, or three
        0.0272
        """
        counts = self._grid(low, top)
        logarithms = self.log_probability(counts)
        highest = logarithms.max()
        return float(highest + np.log(_sums(counts, np.exp(logarithms - highest)).sum()))

    @underflows_to_0
    def _tail_probabilities(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Return counts, and for each the probability of this count or a larger one."""
        counts = self._grid(0, self.frames)
        sums = _sums(counts, np.exp(self.log_probability(counts)))
        # Summing from the smallest terms keeps small tails exact.
        return counts, np.cumsum(sums[::-1])[::-1]

    def _grid(self, low: int, top: int) -> npt.NDArray[np.int64]:
        """Return counts from `low` to `top`: all of them, or of many those that matter."""
        if top - low < _MAX_TERMS:
            return np.arange(low, top + 1, dtype=np.int64)
        a, b = self.mean / self.spread, (1 - self.mean) / self.spread
        # Without a mode inside, the most likely counts are the ends.
        has_mode = a > 1 and b > 1
        mode = (self.frames * (a - 1) + 1 - b) / (a + b - 2) if has_mode else low
        middle = int(np.clip(mode, low, top))
        number = int(np.ceil(_NEAR * np.log((top - low) / _NEAR))) + 1
        far = np.geomspace(_NEAR, top - low, number).astype(np.int64)
        distances = np.concatenate([np.arange(_NEAR), far])
        places = [low + distances, top - distances, middle - distances, middle + distances]
        counts = np.unique(np.concatenate(places))
        return counts[(counts >= low) & (counts <= top)]


def _sums(counts: npt.NDArray[np.int64], probabilities: Array) -> Array:
    """Return the sums from each count to the one before the next. Those between are interpolated.

    Examples
    --------
    >>> _sums(np.array([0, 1, 5]), np.array([1.0, 9.0, 5.0])).tolist()  # 1, 9 + 8 + 7 + 6, 5
    [1.0, 30.0, 5.0]
    """
    steps = np.diff(counts, append=counts[-1] + 1)
    following = np.append(probabilities[1:], 0.0)
    return np.asarray((steps + 1) / 2 * probabilities + (steps - 1) / 2 * following)


def fit_bulk(counts: npt.NDArray[np.integer], frames: int) -> Bulk:
    """Return the distribution of ordinary jots, fitted by maximum likelihood.

    The fit uses the counts from the 2nd to the 70th percentile, with probabilities conditional on
    this range. So hot jots do not affect it, whatever their number and counts, as long as few of
    them lie below the 70th percentile.

    If the 70th percentile is 0, the counts 1 and 2 determine the spread, and they may all belong to
    hot jots. Then the spread is at most the mean: the rates vary by their mean or less.

    Parameters
    ----------
    counts : ndarray of int
        L, in any shape.
    frames : int
        T.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> counts = rng.binomial(1000, 0.01, 10_000)
    >>> counts[:1000] = 900  # a tenth of the jots is hot
    >>> bulk = fit_bulk(counts, 1000)
    >>> abs(bulk.mean - 0.01) < 1e-4, bulk.threshold(1e-4) <= 26
    (True, True)
    """
    from scipy.optimize import minimize

    quantile = int(np.quantile(counts, _MAX_QUANTILE, method="higher"))
    cut = min(max(quantile, _MIN_CUT), frames)
    low = min(int(np.quantile(counts, _MIN_QUANTILE, method="lower")), max(cut - _MIN_CUT, 0))
    values, occurrences = np.unique(counts[(counts >= low) & (counts <= cut)], return_counts=True)
    min_spread, max_mean = 1e-3 / frames, min(_MAX_MEAN * (cut + 1) / frames, 1 - 1e-9)

    def max_spread(mean: float) -> float:
        return max(mean, min_spread) if quantile == 0 else _MAX_SPREAD

    def bulk_at(point: Array) -> Bulk:
        odds = np.exp(np.clip(point[0], -60, 20))
        mean = min(float(odds / (1 + odds)), max_mean)
        # Mirrored at both limits of the spread: a constant cost would stop the search.
        share = 1 - abs(1 - point[1] % 2)
        return Bulk(frames, mean, float(min_spread * (max_spread(mean) / min_spread) ** share))

    def cost(point: Array) -> float:
        bulk = bulk_at(point)
        log_range = bulk.log_mass(low, cut)
        return -float(occurrences @ bulk.log_probability(values) - occurrences.sum() * log_range)

    mean = (float(np.average(values, weights=occurrences)) + 0.1) / (frames + 0.2)
    fits = [
        minimize(
            cost,
            [np.log(mean / (1 - mean)), share],
            method="Nelder-Mead",
            options={"xatol": 1e-4, "fatol": 1e-3},
        )
        for share in (0.3, 0.6)
    ]
    return bulk_at(min(fits, key=lambda fit: fit.fun).x)
