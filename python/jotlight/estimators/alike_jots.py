"""What jots of one kind would report, in place of jots with different efficiency or dark counts."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.blur import blur
from jotlight.estimators.neighbors import (
    STEPS,
    each_filter,
    own_sigma,
    toward_own,
    typical_spread,
)
from jotlight.estimators.whole_counts import carry_debts
from jotlight.sensing.reference import Jot
from jotlight.sensing.response import (
    Array,
    detection_density,
    detection_probability,
    inverse_detection_probability,
    silence_probability,
)

_MIN_LIGHT = 1e-6
"""Smallest light of a jot near which ones are linear."""

_MIN_PROBABILITY = 1e-6
"""Smallest probability of a one or a zero from which the light of a neighborhood is guessed."""

_TINY = 1e-12
"""Smallest variance of a bit, and other divisors."""

_MAX_NOISE = 4.0
"""Number of standard deviations, and of ones, by which a result may differ from its neighborhood.

A jot whose bits contradict its efficiency or its dark counts would change the rest of its row.
"""


def alike_fractions(
    ones: npt.NDArray[np.number],
    trials: Array,
    jots: tuple[Array, Array],
    threshold: int,
    reference: Jot,
    threads: int | None,
    pattern: npt.NDArray[np.integer] | None = None,
) -> Array:
    """Return the fractions of ones that reference jots would report, in [0, 1], (N, H, W).

    With the light s that a pixel and its neighbors have in common, the fraction f of a pixel
    becomes ``p + (f - p_k) √[p (1 - p)] / √[p_k (1 - p_k)]``. A one has the probabilities p_k and p
    at the jots of the pixel and at the reference jot, near s. So a fraction has no bias, and as
    much noise as that of the reference jot. Where the jots say less about the light than the
    reference jot, as hot jots do, the result stays closer to the neighbors. At a high
    signal-to-noise ratio, s is the most likely light of the pixel itself, and the result p.

    What a result has below 0 or above 1 is carried to the next pixels of its row, so that the sum
    of the row stays.

    Parameters
    ----------
    ones, trials : ndarray of shape (N, H, W)
        The counts. Pixels of 0 trials get the fractions of their neighbors.
    jots : (ndarray, ndarray), each of shape (N, H, W)
        η and d of each pixel.
    threshold : int
        q.
    reference : (float, float)
        η and d of the reference jot.
    threads : int, optional
        The number of threads. Default: all cores.
    pattern : ndarray of int, shape (H, W), optional
        The filter of each pixel of a mosaic. Only neighbors with the same one are combined.
        Default: all pixels have the same one.

    Examples
    --------
    >>> dark = np.where(np.arange(64) % 2, 0.05, 0.2) * np.ones((1, 64, 1))
    >>> p = 1 - np.exp(-0.1 - dark)
    >>> ones = np.random.default_rng(0).binomial(4, p)
    >>> jots = np.ones(dark.shape), dark
    >>> found = alike_fractions(ones, np.full(dark.shape, 4.0), jots, 1, (1.0, 0.1), None)
    >>> bool(abs(found.mean() - (1 - np.exp(-0.2))) < 0.01)
    True
    """
    spreads = np.array([typical_spread(float(each.mean())) for each in trials])
    result = np.zeros(ones.shape)
    for spread in np.unique(spreads):
        same = spreads == spread
        result[same] = _alike_fractions(
            ones[same],
            trials[same],
            (jots[0][same], jots[1][same]),
            threshold,
            reference,
            float(spread),
            pattern,
            threads,
        )
    return result


def _alike_fractions(
    ones: npt.NDArray[np.number],
    trials: Array,
    jots: tuple[Array, Array],
    threshold: int,
    reference: Jot,
    spread: float,
    pattern: npt.NDArray[np.integer] | None,
    threads: int | None,
) -> Array:
    """Return :func:`alike_fractions` with averages of a spread, for one kind of filter."""
    fraction = np.divide(ones, trials, out=np.zeros(ones.shape), where=trials > 0)
    result = np.zeros(ones.shape)
    for own in each_filter(pattern, ones.shape[1:]):
        weights = np.where(own, trials, 0.0)
        light = _common_light(fraction, weights, jots, threshold, own_sigma(spread, own), threads)
        light = _toward_own(light, fraction, trials, jots, threshold)
        expected, variance = _bit(jots[0] * light + jots[1], threshold)
        p, reference_variance = _bit(reference[0] * light + reference[1], threshold)
        number = np.maximum(trials, 1)
        limit = _MAX_NOISE * (np.sqrt(reference_variance / number) + 1 / number)
        excess = (fraction - expected) * np.sqrt(reference_variance / variance)
        alike = p + np.clip(excess, -limit, limit)
        # Pixels without trials are filled later, so they pay no debts.
        known = own & (trials > 0)
        paid = carry_debts(np.where(known, alike, 0.0))
        paid = 1 - carry_debts(np.where(known, 1 - paid, 0.0))
        result = np.where(known, paid, np.where(own, p, result))
    return np.clip(result, 0, 1)


def _common_light(
    fraction: Array,
    weights: Array,
    jots: tuple[Array, Array],
    threshold: int,
    sigma: float,
    threads: int | None,
) -> Array:
    """Return the most likely light of each pixel and its neighbors, (N, H, W).

    The likelihood of a neighborhood is that of its pixels with Gaussian weights of a standard
    deviation. It is maximized by Fisher scoring.
    """
    efficiency, dark_counts = jots

    def sums(*parts: Array) -> Sequence[Array]:
        stacked = np.concatenate(parts)
        return [*blur(stacked, sigma, threads).astype(np.float64).reshape(-1, *fraction.shape)]

    total, ones, gain, dark = sums(
        weights, weights * fraction, weights * efficiency, weights * dark_counts
    )
    total = np.maximum(total, _TINY)
    p = np.clip(ones / total, _MIN_PROBABILITY, 1 - _MIN_PROBABILITY)
    rate = inverse_detection_probability(threshold, p, 1 - p)
    light = np.maximum((total * rate - dark) / np.maximum(gain, _TINY), _MIN_LIGHT)
    for _ in range(STEPS):
        rate = efficiency * light + dark_counts
        expected, variance = _bit(rate, threshold)
        slope = efficiency * detection_density(threshold, rate)
        score = weights * slope / variance
        gradient, information = sums(score * (fraction - expected), score * slope)
        light = np.maximum(light + gradient / np.maximum(information, _TINY), _MIN_LIGHT)
    return light


def _toward_own(
    light: Array, fraction: Array, trials: Array, jots: tuple[Array, Array], threshold: int
) -> Array:
    """Return light between that of neighborhoods and the most likely one of each pixel."""
    efficiency, dark_counts = jots
    rate = efficiency * light + dark_counts
    _, variance = _bit(rate, threshold)
    information = trials * (efficiency * detection_density(threshold, rate)) ** 2 / variance
    # A saturated pixel has no most likely light.
    p = np.minimum(fraction, 1 - 0.5 / np.maximum(trials, 1))
    own = inverse_detection_probability(threshold, p, 1 - p) - dark_counts
    return toward_own(light, np.maximum(own / efficiency, _MIN_LIGHT), information)


def _bit(rate: Array, threshold: int) -> tuple[Array, Array]:
    """Return the probability of a one, and the variance of a bit."""
    one = detection_probability(threshold, rate)
    return one, np.maximum(one * silence_probability(threshold, rate), _TINY)
