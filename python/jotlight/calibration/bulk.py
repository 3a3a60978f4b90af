"""The distribution of the dark counts of ordinary jots, with a fit that ignores hot jots."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.sensing.response import Array

_MAX_QUANTILE = 0.7
"""The fit ignores counts above this quantile. Nearly all of them may belong to hot jots."""

_MIN_QUANTILE = 0.02
"""The fit ignores counts below this quantile. They may belong to dead jots."""

_MIN_CUT = 2
"""Minimum range of the counts in the fit. Fewer than three values do not determine a spread."""

_MAX_MEAN = 3
"""Maximum mean of the distribution, in multiples of the largest count in the fit.

If the histogram increases up to this count, the likelihood has no maximum at a finite mean.
"""

_MAX_TERMS = 1 << 16
"""Maximum number of terms in a sum of probabilities. Longer sums use every n-th term, times n."""


@dataclasses.dataclass(frozen=True)
class Bulk:
    """The beta-binomial distribution of the counts of ordinary jots.

    The count of a jot is binomial. Its probability varies over the jots by a beta distribution.

    Parameters
    ----------
    frames : int
        N, the number of frames.
    mean : float
        Mean probability that a jot reports 1 in a frame.
    spread : float
        1/(a + b) of the beta distribution. Near 0, all jots have the same probability.

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

    def threshold(self, false_positive_rate: float) -> int:
        """Return the smallest count whose exact tail probability is at most the rate, or N + 1."""
        counts, tail = self._tail_probabilities()
        above = counts[tail <= false_positive_rate]
        return int(above[0]) if len(above) else self.frames + 1

    def tail_probability(self, ones: int) -> float:
        """Return the probability that an ordinary jot has this count or a larger one.

        Examples
        --------
        >>> round(Bulk(4, 0.2, 1e-9).tail_probability(4), 6)  # 0.2 ** 4
        0.0016
        """
        counts, tail = self._tail_probabilities()
        return float(np.append(tail, 0.0)[np.searchsorted(counts, ones)])

    def _tail_probabilities(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Return counts, and for each the probability of this count or a larger one."""
        counts, step = _grid(0, self.frames)
        probabilities = step * np.exp(self.log_probability(counts))
        # Summing from the smallest terms keeps small tails exact.
        return counts, np.cumsum(probabilities[::-1])[::-1]


def fit_bulk(counts: npt.NDArray[np.integer], frames: int) -> Bulk:
    """Return the distribution of ordinary jots, fitted by maximum likelihood.

    The fit uses the counts from the 2nd to the 70th percentile, with probabilities conditional on
    this range. So hot jots do not affect it, whatever their number and counts, as long as few of
    them lie below the 70th percentile.

    Parameters
    ----------
    counts : ndarray of int
        L, in any shape.
    frames : int
        N.

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
    from scipy.special import logsumexp

    cut = max(int(np.quantile(counts, _MAX_QUANTILE, method="higher")), _MIN_CUT)
    cut = min(cut, frames)
    low = min(int(np.quantile(counts, _MIN_QUANTILE, method="lower")), max(cut - _MIN_CUT, 0))
    values, occurrences = np.unique(counts[(counts >= low) & (counts <= cut)], return_counts=True)
    grid, step = _grid(low, cut)
    min_spread, max_mean = 1e-3 / frames, min(_MAX_MEAN * (cut + 1) / frames, 1 - 1e-9)

    def bulk_at(point: Array) -> Bulk:
        odds, spread = np.exp(np.clip(point, -60, 20))
        return Bulk(
            frames,
            min(float(odds / (1 + odds)), max_mean),
            float(min(max(spread, min_spread), 10.0)),
        )

    def cost(point: Array) -> float:
        bulk = bulk_at(point)
        log_range = logsumexp(bulk.log_probability(grid)) + np.log(step)
        return -float(occurrences @ bulk.log_probability(values) - occurrences.sum() * log_range)

    mean = (float(np.average(values, weights=occurrences)) + 0.1) / (frames + 0.2)
    variance = float(np.average((values - mean * frames) ** 2, weights=occurrences))
    excess = max(variance / max(mean * frames, 1e-9) - 1, 0.05) / frames
    starts = [excess, 30 * excess]
    fits = [
        minimize(
            cost,
            [np.log(mean / (1 - mean)), np.log(start)],
            method="Nelder-Mead",
            options={"xatol": 1e-4, "fatol": 1e-3},
        )
        for start in starts
    ]
    return bulk_at(min(fits, key=lambda fit: fit.fun).x)


def _grid(low: int, top: int) -> tuple[npt.NDArray[np.int64], int]:
    """Return every n-th count from `low` to `top`, and n."""
    step = 1 + (top - low) // _MAX_TERMS
    return np.arange(low, top + 1, step, dtype=np.int64), step
