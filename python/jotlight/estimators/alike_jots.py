"""What jots of one kind would report, in place of jots with different efficiency or dark counts."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.blur import blur
from jotlight.estimators.readings.neighbors import (
    each_filter,
    fisher_scoring,
    own_sigma,
    toward_own,
    typical_spread,
)
from jotlight.estimators.readings.whole_counts import carry_debts
from jotlight.kept import kept_property
from jotlight.sensing.likelihood.reference import Jot
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    intensity_at_probability,
    inverse_detection_probability,
    silence_probability,
)

_MIN_LIGHT = 1e-6
"""Smallest light of a jot near which ones are linear, and smallest probability of a one or a zero
from which the light of a neighborhood is guessed; or that of half a one, if it is smaller."""

_TINY = 1e-12
"""Smallest variance of a bit, and other divisors."""

_MAX_NOISE = 4.0
"""Number of standard deviations, and of ones, by which a result may differ from its neighborhood.

A jot whose bits contradict its efficiency or its dark counts would change the rest of its row.
"""


@dataclasses.dataclass(frozen=True)
class DifferentJots:
    """Counts of pixels whose jots differ. Each map has the shape (N, H, W)."""

    ones: npt.NDArray[np.number]
    trials: Array
    efficiency: Array
    """η of the jots of each pixel."""
    dark_counts: Array
    """d."""
    threshold: int
    """q."""

    @kept_property
    def fraction(self) -> Array:
        """The fraction of ones, 0 without trials."""
        none = np.zeros(self.ones.shape)
        return np.asarray(np.divide(self.ones, self.trials, out=none, where=self.trials > 0))

    def __getitem__(self, images: npt.NDArray[np.bool_]) -> "DifferentJots":
        """Return the counts of some of the N images."""
        return dataclasses.replace(
            self,
            ones=self.ones[images],
            trials=self.trials[images],
            efficiency=self.efficiency[images],
            dark_counts=self.dark_counts[images],
        )

    @kept_property
    def min_light(self) -> Array:
        """The smallest light of each image, (N, 1, 1)."""
        largest = self.trials.max(axis=(1, 2), keepdims=True)
        return np.asarray(np.minimum(_MIN_LIGHT, 0.5 / np.maximum(largest, 1)))

    def rate(self, light: Array) -> Array:
        """Return η s + d."""
        return self.efficiency * light + self.dark_counts


def alike_fractions(
    counts: DifferentJots,
    reference: Jot,
    pattern: npt.NDArray[np.integer] | None = None,
    threads: int | None = None,
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
    counts : DifferentJots
        The counts. Pixels of 0 trials get the fractions of their neighbors.
    reference : Jot
        η and d of the reference jot.
    pattern : ndarray of int, shape (H, W), optional
        The filter of each pixel of a mosaic. Only neighbors with the same one are combined.
        Default: all pixels have the same one.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> dark = np.where(np.arange(64) % 2, 0.05, 0.2) * np.ones((1, 64, 1))
    >>> p = 1 - np.exp(-0.1 - dark)
    >>> ones = np.random.default_rng(0).binomial(4, p)
    >>> counts = DifferentJots(ones, np.full(p.shape, 4.0), np.ones(p.shape), dark, threshold=1)
    >>> found = alike_fractions(counts, reference=Jot(1.0, 0.1))
    >>> bool(abs(found.mean() - (1 - np.exp(-0.2))) < 0.01)
    True
    """
    spreads = np.array(
        [
            typical_spread(float(trials.mean()), information)
            for trials, information in zip(counts.trials, _typical_information(counts), strict=True)
        ]
    )
    result = np.zeros(counts.ones.shape)
    for spread in np.unique(spreads):
        same = spreads == spread
        images = counts[same]
        part = np.zeros(images.ones.shape)
        for own in each_filter(pattern, part.shape[1:]):
            found = _fractions_of_filter(images, reference, own, own_sigma(spread, own), threads)
            part = np.where(own, found, part)
        result[same] = part
    return np.clip(result, 0, 1)


def _fractions_of_filter(
    counts: DifferentJots,
    reference: Jot,
    own: npt.NDArray[np.bool_],
    sigma: float,
    threads: int | None,
) -> Array:
    """Return the fractions of the pixels (H, W) of one filter. Those of others mean nothing.

    Pixels are combined with their neighbors by a Gaussian filter with a standard deviation.
    """
    fraction, trials = counts.fraction, counts.trials

    def sums(*parts: Array) -> list[Array]:
        stacked = np.concatenate(parts)
        return [*blur(stacked, sigma, threads).astype(np.float64).reshape(-1, *fraction.shape)]

    light = _toward_own(counts, _common_light(counts, np.where(own, trials, 0.0), sums))
    expected, variance = _bit(counts.rate(light), counts.threshold)
    p, reference_variance = _bit(
        reference.efficiency * light + reference.dark_counts, counts.threshold
    )
    number = np.maximum(trials, 1)
    limit = _MAX_NOISE * (np.sqrt(reference_variance / number) + 1 / number)
    excess = (fraction - expected) * np.sqrt(reference_variance / variance)
    alike = p + np.clip(excess, -limit, limit)
    # Pixels without trials are filled later, so they pay no debts.
    known = own & (trials > 0)
    paid = carry_debts(np.where(known, alike, 0.0))
    paid = 1 - carry_debts(np.where(known, 1 - paid, 0.0))
    return np.where(known, paid, p)


def _common_light(
    counts: DifferentJots, weights: Array, sums: Callable[..., Sequence[Array]]
) -> Array:
    """Return the most likely light of neighborhoods of pixels.

    Parameters
    ----------
    counts : DifferentJots
        The counts.
    weights : ndarray of shape (N, H, W)
        The weights of the pixels.
    sums : callable
        ``sums(*parts)`` returns the sum or the mean of each part (N, H, W) over neighborhoods.
    """
    fraction, threshold = counts.fraction, counts.threshold
    efficiency, dark_counts = counts.efficiency, counts.dark_counts

    def derivatives(light: Array) -> tuple[Array, Array]:
        rate = counts.rate(light)
        expected, variance = _bit(rate, threshold)
        slope = efficiency * detection_density(threshold, rate)
        score = weights * slope / variance
        gradient, information = sums(score * (fraction - expected), score * slope)
        return gradient, information

    total, ones, gain, dark = sums(
        weights, weights * fraction, weights * efficiency, weights * dark_counts
    )
    total = np.maximum(total, _TINY)
    least = counts.min_light
    p = np.clip(ones / total, least, 1 - least)
    rate = inverse_detection_probability(threshold, p, 1 - p)
    start = np.maximum((total * rate - dark) / np.maximum(gain, _TINY), least)
    return fisher_scoring(start, derivatives, least)


def _typical_information(counts: DifferentJots) -> Array:
    """Return the mean information of a pixel about the logarithm of its light, (N,).

    The light is the most likely one of a whole image.
    """

    def means(*parts: Array) -> list[Array]:
        return [np.asarray(part.mean((1, 2), keepdims=True)) for part in parts]

    light = _common_light(counts, counts.trials, means)
    (information,) = means(_information(counts, light))
    return np.asarray(light**2 * information)[:, 0, 0]


def _information(counts: DifferentJots, light: Array) -> Array:
    """Return the Fisher information of each pixel about its light, (N, H, W)."""
    rate = counts.rate(light)
    _, variance = _bit(rate, counts.threshold)
    slope = counts.efficiency * detection_density(counts.threshold, rate)
    return np.asarray(counts.trials * slope**2 / variance)


def _toward_own(counts: DifferentJots, light: Array) -> Array:
    """Return light between that of neighborhoods and the most likely one of each pixel."""
    efficiency, trials, threshold = counts.efficiency, counts.trials, counts.threshold
    # A saturated pixel has no most likely light.
    p = np.minimum(counts.fraction, 1 - 0.5 / np.maximum(trials, 1))
    own = intensity_at_probability(threshold, p, 1 - p, efficiency, counts.dark_counts)
    return toward_own(light, np.maximum(own, counts.min_light), _information(counts, light))


def _bit(rate: Array, threshold: int) -> tuple[Array, Array]:
    """Return the probability of a one, and the variance of a bit."""
    one = detection_probability(threshold, rate)
    return one, np.maximum(one * silence_probability(threshold, rate), _TINY)
