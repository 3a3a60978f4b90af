"""The dark counts of ordinary jots: a distribution that hot jots cannot pull at."""

import dataclasses

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SHARE = 0.7
"""The lower part of all jots that the fit looks at. Hot jots may be nearly all of the others."""

_LOWEST = 0.02
"""The lowest part, which it does not look at either: there are dead jots, were there light."""

_LEAST_CUT = 2
"""Counts 0, 1 and 2 are looked at in any case: fewer than three values tell no spread."""

_MOST_MEAN = 3
"""Times the cut that the mean may be. Counts that rise up to the cut would make it infinite."""

_MOST_TERMS = 1 << 16
"""Terms of a sum of probabilities; of more, every few are taken, where neighbours hardly differ."""


@dataclasses.dataclass(frozen=True)
class Bulk:
    """Counts of ordinary jots: beta-binomial, a binomial whose chance differs from jot to jot.

    Parameters
    ----------
    frames : int
        N, frames that were counted over.
    mean : float
        Mean of the chances that a jot fires in a frame.
    spread : float
        1/(a + b) of the beta distribution; near 0 all jots have the same chance.

    Examples
    --------
    >>> Bulk(1000, 0.01, 1e-9).threshold(1e-4)  # 10 counts in the mean, Poisson
    25
    >>> Bulk(1000, 0.01, 1e-2).threshold(1e-4)  # the rates differ as much as their mean
    94
    """

    frames: int
    mean: float
    spread: float

    def log_probability(self, counts: npt.ArrayLike) -> Array:
        """Logarithm of the probability of each count."""
        from scipy.special import betaln

        k, n = np.asarray(counts, np.float64), float(self.frames)
        a, b = self.mean / self.spread, (1 - self.mean) / self.spread
        chosen = -betaln(k + 1, n - k + 1) - np.log1p(n)
        return np.asarray(chosen + betaln(k + a, n - k + b) - betaln(a, b))

    def threshold(self, false_positive_rate: float) -> int:
        """The least count that at most this share of ordinary jots reaches; N + 1 if there is none.

        Found from the exact tail of the distribution.
        """
        counts, tail = self._tails()
        above = counts[tail <= false_positive_rate]
        return int(above[0]) if len(above) else self.frames + 1

    def chance(self, ones: int) -> float:
        """The share of ordinary jots that have so many ones or more.

        Examples
        --------
        >>> round(Bulk(4, 0.2, 1e-9).chance(4), 6)  # 0.2 ** 4
        0.0016
        """
        counts, tail = self._tails()
        return float(np.append(tail, 0.0)[np.searchsorted(counts, ones)])

    def _tails(self) -> tuple[npt.NDArray[np.int64], Array]:
        """Counts, and the chance of each of them or more."""
        counts, step = _grid(0, self.frames)
        chances = step * np.exp(self.log_probability(counts))
        # From the far end, where the terms are smallest, so that small tails are exact.
        return counts, np.cumsum(chances[::-1])[::-1]


def fit_bulk(counts: npt.NDArray[np.integer], frames: int) -> Bulk:
    """Fit the counts of ordinary jots to the lower part of a map, by maximum likelihood.

    Only counts from the 2nd to the 70th percentile (which is taken for 2 at least) are looked at,
    with the probabilities *given* that a count is among them. So neither how hot hot jots are nor
    how many of them there are matters, as long as few are below the cut.

    Parameters
    ----------
    counts : ndarray of int
        L, of any shape.
    frames : int
        N.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> counts = rng.binomial(1000, 0.01, 10_000)
    >>> counts[:1000] = 900  # a tenth is hot
    >>> bulk = fit_bulk(counts, 1000)
    >>> abs(bulk.mean - 0.01) < 1e-4, bulk.threshold(1e-4) <= 26
    (True, True)
    """
    from scipy.optimize import minimize
    from scipy.special import logsumexp

    cut = max(int(np.quantile(counts, _SHARE, method="higher")), _LEAST_CUT)
    cut = min(cut, frames)
    low = min(int(np.quantile(counts, _LOWEST, method="lower")), max(cut - _LEAST_CUT, 0))
    values, number = np.unique(counts[(counts >= low) & (counts <= cut)], return_counts=True)
    grid, step = _grid(low, cut)
    least, most = 1e-3 / frames, min(_MOST_MEAN * (cut + 1) / frames, 1 - 1e-9)

    def bulk(point: Array) -> Bulk:
        odds, spread = np.exp(np.clip(point, -60, 20))
        return Bulk(
            frames, min(float(odds / (1 + odds)), most), float(min(max(spread, least), 10.0))
        )

    def cost(point: Array) -> float:
        here = bulk(point)
        given = logsumexp(here.log_probability(grid)) + np.log(step)
        return -float(number @ here.log_probability(values) - number.sum() * given)

    middle = (float(np.average(values, weights=number)) + 0.1) / (frames + 0.2)
    variance = float(np.average((values - middle * frames) ** 2, weights=number))
    over = max(variance / max(middle * frames, 1e-9) - 1, 0.05) / frames
    starts = [over, 30 * over]
    ends = [
        minimize(
            cost,
            [np.log(middle / (1 - middle)), np.log(start)],
            method="Nelder-Mead",
            options={"xatol": 1e-4, "fatol": 1e-3},
        )
        for start in starts
    ]
    return bulk(min(ends, key=lambda end: end.fun).x)


def _grid(low: int, top: int) -> tuple[npt.NDArray[np.int64], int]:
    """Counts from `low` to `top`, or every few of them, and how many each stands for."""
    step = 1 + (top - low) // _MOST_TERMS
    return np.arange(low, top + 1, step, dtype=np.int64), step
