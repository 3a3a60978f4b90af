"""The distribution of the estimate of a pixel whose readings may differ, before a capture.

The scores of readings are the derivatives of their log-likelihoods at the true light. Their sum
determines the estimate: it is the light at which this sum is expected. For equal bits, this is
`jotlight.mle` exactly. Otherwise `jotlight.mle` uses the scores at its own estimate. Its error then
differs by up to 0.6 dB for a few readings, and by less than 0.3 dB for about 64 readings or more.
For brackets, it differs by up to 2 dB. The error is larger with several bits, read noise, and light
that does not exceed its error by much: the scores at the estimate then differ much from those at
the true light (decision 34). ``saddle_point`` has the error of equal readings then.

The Cramér-Rao bound does not say this. Where most information comes from rare readings, such as the
few zeros of nearly saturated bits, a few frames rarely have one, and are far above the bound.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Integers
from jotlight.kept import kept_property
from jotlight.sensing.likelihood.multibit import ReadingLikelihood
from jotlight.sensing.parameters.response import JotResponse
from jotlight.underflow import underflows_to_0

_MIN_SUMS = 1 << 12
"""Minimum number of sums of scores whose probabilities are computed."""

_MAX_SUMS = 1 << 15
"""Maximum number of sums of scores whose probabilities are computed."""

_DEVIATIONS = 12
"""Number of standard deviations from the mean at which the distribution of a sum ends."""

_STEPS = 20
"""Number of steps of the sums in a standard deviation. Rounding is below a step."""

_MIN_STEPS = 8
"""Minimum number of steps. A distribution that needs more sums is normal."""

_NORMAL_STEPS = 2401
"""Number of sums that stand for a normal distribution."""

_NEGLIGIBLE = 1e-15
"""Largest probability that is due to rounding."""

_CERTAIN = 1e-12
"""Largest probability of a reading that does not occur."""


Part = tuple[int, Array, Array]
"""The number of readings of a group, the probabilities of readings, and their scores."""

_LEVELS = 257
"""Number of levels of light for each group at which sums are expected."""

_MAX_SCORES = 1 << 11
"""Maximum number of levels and groups whose scores are kept, each in up to 40 kB."""


@dataclasses.dataclass(frozen=True, eq=False)
class PlannedGroup:
    """Equal readings of a pixel.

    Parameters
    ----------
    response : JotResponse
        The response of the jots.
    efficiency, dark_counts : float
        Those of all jots.
    exposure : float
        The light of these readings at a level of 1.
    """

    response: JotResponse
    efficiency: float
    dark_counts: float
    exposure: float = 1.0

    @kept_property
    def jot(self) -> ReadingLikelihood:
        """The likelihood of a reading."""
        none = np.zeros((1, 0), np.int32)
        return ReadingLikelihood(self.response, none, False, self.efficiency, self.dark_counts)

    def limit(self, level: float) -> "PlannedGroup":
        """Return the group without large readings that do not occur up to a level of light."""
        highest, noise, threshold = self.response
        rate = self.efficiency * self.exposure * level + self.dark_counts
        largest = int(rate + _reach(rate, noise)) + 1
        if highest == 1 or largest >= highest:
            return self
        highest = (1 << largest.bit_length()) - 1
        return dataclasses.replace(self, response=JotResponse(highest, noise, threshold))

    @property
    def levels(self) -> Array:
        """Levels of light from 0 until all readings are the largest one."""
        highest, noise, threshold = self.response
        rate = float(highest + threshold)
        top = rate + _reach(rate, noise)
        rates = np.linspace(0, np.sqrt(top), _LEVELS) ** 2
        return np.maximum(rates - self.dark_counts, 0) / (self.efficiency * self.exposure)

    def probabilities(self, levels: Array) -> tuple[Integers, Integers, Array]:
        """Return indices of levels, readings, and their probabilities, as far as they occur."""
        highest, noise, _ = self.response
        rates = self.efficiency * self.exposure * levels + self.dark_counts
        first = np.zeros(rates.size, np.int64)
        stop = np.full(rates.size, highest + 1)
        if highest > 1:
            reach = _reach(rates, noise)
            first = np.clip(rates - reach, 0, highest).astype(np.int64)
            stop = np.clip(rates + reach, 0, highest).astype(np.int64) + 1
        sizes = stop - first
        rows = np.repeat(np.arange(rates.size), sizes)
        readings = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes) + first[rows]
        return rows, readings, self.jot.probability(readings, self.exposure * levels[rows])

    def scores(self, readings: Integers, level: float | Array) -> Array:
        """Return the derivatives of the log-likelihoods of readings about a level of light.

        The level may differ between readings.
        """
        light = np.broadcast_to(self.exposure * np.asarray(level), readings.shape)
        each = dataclasses.replace(self.jot, sample=readings.astype(np.int32)[:, None])
        return self.exposure * each.gradient_and_curvature(light)[0]


class PlannedEstimates:
    """The distribution of the estimate of a pixel, from the readings of some groups.

    Parameters
    ----------
    groups : sequence of PlannedGroup
        The groups.
    max_level : float
        The largest light at which the error is wanted.

    Examples
    --------
    >>> bits = PlannedGroup(JotResponse(1, 0.0, 1), 1.0, 0.0)
    >>> bias, mse = PlannedEstimates([bits], 1.0).bias_and_mse([1], 0.3, np.log(2))
    >>> round(bias, 4)  # (1 - exp(-0.3)) log(2) - 0.3
    -0.1203
    """

    def __init__(self, groups: Sequence[PlannedGroup], max_level: float) -> None:
        self._groups = [group.limit(max_level) for group in groups]
        self._levels = np.unique(np.concatenate([group.levels for group in self._groups]))
        self._tables = [group.probabilities(self._levels) for group in self._groups]
        self._scores = functools.lru_cache(_MAX_SCORES)(self._scores_of_group)

    def bias_and_mse(
        self, numbers: Sequence[int], level: float, max_estimate: float
    ) -> tuple[float, float]:
        """Return the bias and the mean square error at a level of light.

        Parameters
        ----------
        numbers : sequence of int
            The number of readings of each group.
        level : float
            The true light.
        max_estimate : float
            The largest estimate.
        """
        used = [index for index, number in enumerate(numbers) if number]
        scores = [self._scores(index, level) for index in used]
        parts = [(numbers[index], *each[:2]) for index, each in zip(used, scores, strict=True)]
        # All readings are the largest, or all are 0, whose estimate is 0.
        for extreme, others in ((max_estimate, slice(-1)), (0.0, slice(1, None))):
            if sum(number * float(p[others].sum()) for number, p, _ in parts) < _CERTAIN:
                return extreme - level, (extreme - level) ** 2
        variance = float(sum(number * (p @ np.square(score)) for number, p, score in parts))
        sums, weights, step = _distribution(parts, float(np.sqrt(variance)))
        expected = sum(numbers[index] * each[2] for index, each in zip(used, scores, strict=True))
        light = _invert(self._levels, np.asarray(expected), level, variance)(sums)
        is_saturated = sums >= np.max(expected) - step / 2
        error = np.where(is_saturated, max_estimate, np.minimum(light, max_estimate)) - level
        return float(weights @ error), float(weights @ error**2)

    def _scores_of_group(self, index: int, level: float) -> tuple[Array, Array, Array]:
        """Return the probabilities of readings, their scores, and the mean score at each level.

        A reading that does not occur at this light has the score of the nearest one that does.
        """
        group = self._groups[index]
        _, readings, probabilities = group.probabilities(np.array([level]))
        scores = group.scores(readings, level)
        rows, columns, table = self._tables[index]
        near = np.clip(columns - readings[0], 0, readings.size - 1)
        expected = np.bincount(rows, table * scores[near], self._levels.size)
        return probabilities, scores, np.asarray(expected, np.float64)


def _reach(rate: float | Array, noise: float) -> Array:
    """Return how far readings are from a rate at most."""
    return np.asarray(_DEVIATIONS * np.sqrt(rate + noise**2) + 2 * _DEVIATIONS)


def _distribution(parts: list[Part], deviation: float) -> tuple[Array, Array, float]:
    """Return the sums of scores of some groups, their probabilities, and the step of the sums.

    The mean of the sums is 0.
    """
    from scipy.fft import next_fast_len

    origin, low, high, others, largest, gap = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    kept = []
    for number, probabilities, scores in parts:
        mode, second = _two_most_likely(probabilities)
        steps = np.where(number * probabilities > _NEGLIGIBLE, scores - scores[mode], 0.0)
        kept.append((number, probabilities, steps))
        origin += number * scores[mode]
        others += number * float(np.delete(probabilities, mode).sum())
        low, high = low + number * steps.min(), high + number * steps.max()
        largest, gap = max(largest, float(np.abs(steps).max())), abs(float(steps[second]))
    half = _DEVIATIONS * deviation + 3 * largest
    if high - low > 2 * half:
        low, high = -half - origin, half - origin
    # A score between two steps is divided among them, which adds up to 1/4 of a squared step.
    spread = max(1.0, np.sqrt(others) / 2)
    step = min(deviation / (_STEPS * spread), (high - low) / _MIN_SUMS)
    margin = int(_DEVIATIONS * spread) + 4
    step = max(step, (high - low) / max(_MAX_SUMS - 2 * margin, 1))
    if step * spread * _MIN_STEPS > deviation:
        normal = np.linspace(-_DEVIATIONS, _DEVIATIONS, _NORMAL_STEPS)
        weights = np.exp(-(normal**2) / 2)
        return deviation * normal, weights / weights.sum(), 0.0
    if gap > step and len(parts) == 1:  # the two most likely readings need no rounding
        step = gap / np.ceil(gap / step)
    first = int(np.floor(low / step)) - margin
    length = next_fast_len(int(np.ceil((high - low) / step)) + 2 * margin, real=True)
    weights = _probabilities_of_sums(kept, step, length)
    sums = np.arange(first, first + length)
    occur = weights[sums % length] > 0
    sums, weights = sums[occur], weights[sums % length][occur]
    return origin + sums * step, weights / weights.sum(), step


def _two_most_likely(probabilities: Array) -> tuple[int, int]:
    """Return the two most likely readings, or the same one twice if no other occurs."""
    order = np.argsort(probabilities)
    return int(order[-1]), int(order[-2:][0])


def _probabilities_of_sums(parts: list[Part], step: float, length: int) -> Array:
    """Return the probabilities of sums in steps, modulo a length."""
    from scipy.fft import irfft, rfft

    transform = np.ones(length // 2 + 1, np.complex128)
    for number, probabilities, values in parts:
        place = np.floor(values / step).astype(np.int64)
        upper = probabilities * (values / step - place)
        one = np.bincount(place % length, probabilities - upper, length)
        one += np.bincount((place + 1) % length, upper, length)
        transform *= _power(rfft(one), number)
    weights = irfft(transform, length)
    return np.asarray(np.where(weights < _NEGLIGIBLE, 0, weights))


@underflows_to_0
def _power(values: npt.NDArray[np.complex128], exponent: int) -> npt.NDArray[np.complex128]:
    """Return a positive whole power of complex numbers by squaring, as NumPy's power is slow.

    Examples
    --------
    >>> _power(np.array([1j, 2.0]), 5).tolist()
    [1j, (32+0j)]
    """
    power = values if exponent % 2 else np.ones_like(values)
    while exponent := exponent >> 1:
        values = values * values
        if exponent % 2:
            power = power * values
    return power


def _invert(
    levels: Array, expected: Array, level: float, variance: float
) -> Callable[[Array], Array]:
    """Return the function from a sum to the light at which it is expected.

    At the true light, 0 is expected, and the slope is the variance of the sum.
    """
    from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

    is_below, is_above = levels < level, levels > level
    rising = np.concatenate(
        [np.minimum(expected[is_below], 0), [0.0], np.maximum(expected[is_above], 0)]
    )
    light = np.concatenate([levels[is_below], [level], levels[is_above]])
    rising, first = np.unique(np.maximum.accumulate(rising), return_index=True)
    if rising.size < 2:
        return lambda sums: np.full(sums.size, level)
    center = int(np.searchsorted(rising, 0.0))
    light = light[first]
    light[center] = level
    slopes = PchipInterpolator(rising, light).derivative()(rising)
    slopes[center] = 1 / variance
    spline = CubicHermiteSpline(rising, light, slopes)
    return lambda sums: np.asarray(spline(np.clip(sums, rising[0], rising[-1])))
