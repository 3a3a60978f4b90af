"""Counts of free-running pixels, which are blind for a dead time after each detection."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import (
    as_counts,
    number_in_range,
    positive_number,
    refuse_masked,
    shown,
    to_array,
    type_of,
)
from jotlight.estimators.photon_counters.merge_detections import merge_detections
from jotlight.estimators.photon_counters.renewal import Renewal
from jotlight.estimators.readings.reference_sensors import MAX_RATE
from jotlight.interrupts import interruptible
from jotlight.parameter_names import takes_rng
from jotlight.seeds import SeedLike, seed_bytes
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

_MAX_DETECTIONS = 5e8
"""Largest number of detections whose short readings a sensor can number."""

_ADVICE = (
    "; it is a fraction of the exposure time, so divide seconds by that time; if the fraction is "
    "smaller, n detections would be n / (1 - n * dead_time) without it, almost exactly"
)

_SATURATED_RATE = 1e30
"""Higher rates count as this one, at which all pixels are at saturation."""

_MASKED_ADVICE = "fill it, and pass its mask to merge(counts, light, mask=…)"


@dataclasses.dataclass(frozen=True, kw_only=True)
class FreeRunning:
    """A pixel that counts photons, and is blind for a dead time after each detection.

    The pixel is live at the beginning of the exposure. Photons during the dead time are lost and do
    not prolong it. Light is in photons per exposure time, 0 or more. Methods take numbers or arrays
    of any shape, and return arrays of float64 of that shape. Counts and light are broadcast. A
    count or a light out of range raises ValueError.

    Parameters
    ----------
    dead_time : float
        τ: the dead time as a fraction of the exposure time, 1e-7 to 1; a dead time of 50 ns and an
        exposure time of 10 µs make 0.005.
    efficiency : float
        η: the fraction of the photons that are detected, above 0 to 1.
    dark_counts : float
        d: the expected detections per exposure time without light, if there were no dead time.

    Raises
    ------
    ValueError
        When a number is out of range.

    Notes
    -----
    The times between detections are independent, so n or more detections take n exponential times
    and n - 1 dead times. With the rate r = η s + d and the remaining time u(n) = 1 - (n - 1) τ, it
    is P(N ≥ n) = P(n, r u(n)), the regularized lower incomplete gamma function. The number of
    detections therefore saturates at the smallest whole number that is 1/τ or more.

    Examples
    --------
    >>> pixel = jl.FreeRunning(dead_time=0.01)
    >>> pixel.max_count, pixel.mean(100.0).round(1).tolist()  # about r / (1 + r τ)
    (100, 50.1)
    >>> pixel.mle([0, 50, 99]).round(1).tolist()
    [0.0, 99.5, 6898.3]
    """

    dead_time: float
    efficiency: float = 1.0
    dark_counts: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high, advice in (
            ("dead_time", 1e-7, 1.0, _ADVICE),  # most smaller numbers are seconds
            ("efficiency", 1e-18, 1.0, ""),
            ("dark_counts", 0.0, 1e18, ""),
        ):
            value = number_in_range(name, getattr(self, name), low, high, advice)
            object.__setattr__(self, name, value)

    @property
    def max_count(self) -> int:
        """The largest number of detections in the exposure time."""
        return self._renewal.max_count

    @property
    def _renewal(self) -> Renewal:
        return Renewal(self.dead_time)

    def at_least(self, count: npt.ArrayLike, light: npt.ArrayLike) -> Array:
        """Return P(N ≥ n), the probability of `count` detections or more, in [0, 1].

        `count` is 0 to :attr:`max_count` + 1, whose probability is 0.

        Examples
        --------
        >>> jl.FreeRunning(dead_time=0.3).at_least([0, 1, 5], 2.0).round(4).tolist()
        [1.0, 0.8647, 0.0]
        """
        return self._renewal.at_least(self._checked(count, 1), self._rate(light))

    def probability(self, count: npt.ArrayLike, light: npt.ArrayLike) -> Array:
        """Return P(N = n), the probability of `count` detections, in [0, 1].

        `count` is 0 to :attr:`max_count`.

        Examples
        --------
        >>> pixel = jl.FreeRunning(dead_time=0.3)
        >>> pixel.probability([0, 1, 2, 3, 4], 2.0).round(4).tolist()
        [0.1353, 0.4565, 0.3607, 0.0474, 0.0001]
        """
        n = self._checked(count)[..., None] + np.arange(2)
        return self._renewal.probabilities(n, self._rate(light)[..., None])[..., 0]

    def mean(self, light: npt.ArrayLike) -> Array:
        """Return the expected number of detections: the sum of P(N ≥ n) over n from 1.

        Examples
        --------
        >>> jl.FreeRunning(dead_time=0.01).mean([100.0, np.inf]).round(1).tolist()
        [50.1, 100.0]
        """
        return self._renewal.mean(self._rate(light))

    @takes_rng
    def draw(self, light: npt.ArrayLike, rng: SeedLike = None) -> npt.NDArray[np.int64]:
        """Return random counts for an array of light. `rng` is a seed, a generator, or None.

        Examples
        --------
        >>> jl.FreeRunning(dead_time=0.01).draw(np.full(3, 1e9), rng=0).tolist()
        [100, 100, 100]
        """
        levels = np.asarray(to_array("light", light), np.float64)
        seed = np.frombuffer(seed_bytes(rng), np.uint32)
        uniform = np.random.default_rng(seed).random(levels.shape)
        low, high = np.zeros(levels.shape, np.int64), np.full(levels.shape, self.max_count)
        while (low < high).any():
            middle = (low + high + 1) // 2
            is_more = uniform < self.at_least(middle, levels)
            low, high = np.where(is_more, middle, low), np.where(is_more, high, middle - 1)
        return low

    def mle(self, counts: npt.ArrayLike) -> Array:
        """Return the most likely light of each count, in photons per exposure time.

        A count at saturation has no largest likelihood, and is infinite.

        Notes
        -----
        With u = u(n) and w = u(n + 1) = u - τ, the likelihood is highest at the rate r with
        r τ exp(r τ) = n τ uⁿ / wⁿ⁺¹. So r = W(n τ uⁿ / wⁿ⁺¹)/τ, where W is Lambert's function.
        """
        from scipy.special import wrightomega

        n, tau = self._checked(counts).astype(np.float64), self.dead_time
        used, rest = self._renewal.rest(n), self._renewal.rest(n + 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithm = np.log(n * tau) + n * np.log(used) - (n + 1) * np.log(rest)
            rate = np.where(n > 0, interruptible(wrightomega)(logarithm) / tau, 0.0)
        rate = np.where(rest > 0, rate, np.inf)
        return np.asarray(np.maximum(rate - self.dark_counts, 0) / self.efficiency)

    def interval(
        self, counts: npt.ArrayLike, confidence_level: float = 0.95
    ) -> tuple[Array, Array]:
        """Return the ends of the exact interval of the light of each count.

        The probability of the count or more at the lower end is (1 - `confidence_level`)/2, and so
        is that of the count or less at the upper end. So the coverage is at least
        `confidence_level`. At saturation, the upper end is infinite.

        Parameters
        ----------
        counts : array_like of int, any shape
            The counts, 0 to :attr:`max_count`.
        confidence_level : float
            The confidence level, 0.5 to 1 - 1e-12.

        Returns
        -------
        low, high : ndarray of float64
            The ends in photons per exposure time, of the shape of the counts.

        Raises
        ------
        ValueError
            When a count or the confidence level is out of range.

        Examples
        --------
        >>> low, high = jl.FreeRunning(dead_time=0.01).interval([0, 50, 100])
        >>> low.round(1).tolist(), high.round(1).tolist()
        ([0.0, 72.8, 8136.4], [3.7, 131.8, inf])
        """
        from scipy.special import gammaincinv

        level = number_in_range("confidence_level", confidence_level, 0.5, 1 - 1e-12)
        n, tail = self._checked(counts).astype(np.float64), (1 - level) / 2
        used, rest = self._renewal.rest(n), self._renewal.rest(n + 1)
        invert = interruptible(gammaincinv)
        with np.errstate(divide="ignore", invalid="ignore"):
            low = np.where(n > 0, invert(np.maximum(n, 1), tail) / used, 0.0)
            high = np.where(rest > 0, invert(n + 1, 1 - tail) / np.maximum(rest, 0), np.inf)
        lower, upper = (
            np.maximum(rate - self.dark_counts, 0) / self.efficiency for rate in (low, high)
        )
        return lower, upper

    def information(self, light: npt.ArrayLike) -> Array:
        """Return the Fisher information of a count about the light.

        Examples
        --------
        >>> jl.FreeRunning(dead_time=1e-4).information(10.0).round(4).tolist()  # 1/10 without τ
        0.0999
        """
        return self.efficiency**2 * self._renewal.information(self._rate(light))

    def score(self, counts: npt.ArrayLike, light: npt.ArrayLike) -> Array:
        """Return the derivative of log P(N = n) by the light, per photon.

        Examples
        --------
        >>> jl.FreeRunning(dead_time=0.01).score([0, 50], [1.0, 90.0]).round(3).tolist()
        [-1.0, 0.053]
        """
        return self.efficiency * self._renewal.score(self._checked(counts), self._rate(light))

    def merge(
        self,
        counts: npt.ArrayLike,
        light: float,
        *,
        mask: npt.ArrayLike | None = None,
        max_intensity: float = 1.0,
        near_neighbors: bool = True,
    ) -> Merged:
        """Return equivalent counts: those of one-bit readings, for methods that take counts.

        They have the derivative and the information of the log-likelihood of each count near an
        average over its neighbors. All methods and K-conditioned networks take the result. For
        maximum likelihood, :meth:`mle` and :meth:`interval` of the counts themselves are exact.

        Parameters
        ----------
        counts : array_like of int, shape (H, W)
            The counts.
        light : float
            Photons per exposure time at intensity 1, above 0.
        mask : array_like of bool, shape (H, W), optional
            True marks dead pixels. Their counts have no effect. Default: no pixel is dead.
        max_intensity : float
            S: the largest intensity, above 0. Estimates lie in [0, S].
        near_neighbors : bool
            False for counts at the most likely intensity of each pixel instead, which they keep.
            From these, denoisers make images that are too bright if counts are low, or near
            saturation.

        Returns
        -------
        Merged
            Ones and trials (H, W). Their sensor divides the exposure into readings of one bit that
            are short enough for at most 1/4 detection each. With ``units="photons"``, estimates
            are detected photons per exposure time, as if there were no dead time.

        Raises
        ------
        TypeError, ValueError
            When a count or a number is out of range, or the counts are not those of one image.

        Notes
        -----
        The formulas are those of :func:`jotlight.merge_readings`.

        Where all counts around a pixel are saturated, they say only that the light is bright. There
        the estimates are too dark, and their intervals are too narrow. `flags` marks these pixels.

        Examples
        --------
        >>> pixel, counts = jl.FreeRunning(dead_time=0.01), [[0, 20, 50]]
        >>> merged = pixel.merge(counts, light=200.0, near_neighbors=False)
        >>> (merged.ones / merged.trials).round(3).tolist()  # p = 1 - exp(-s) of the readings
        [[0.0, 0.031, 0.117]]
        """
        light = positive_number("light", light)
        largest = positive_number("max_intensity", max_intensity)
        refuse_masked("counts", counts, _MASKED_ADVICE)
        image = as_counts(counts)
        if image.ndim != 2:
            raise ValueError(f"counts: expected one image of shape (H, W), got {image.shape}")
        rate = self.efficiency * light * largest + self.dark_counts
        if rate > _MAX_DETECTIONS:
            raise ValueError(
                f"light: expected at most {_MAX_DETECTIONS:g} detections per exposure time at the "
                f"largest intensity, with dark counts, got {rate:g}"
            )
        sensor = Sensor(
            frames=(frames := max(1, int(np.ceil(rate / MAX_RATE)))),
            gain=light,
            efficiency=self.efficiency,
            dark_counts=self.dark_counts / frames,
            max_intensity=largest,
            mask=None if mask is None else to_array("mask", mask),
        )
        sensor.check_map_shapes(*image.shape)
        detections = self._checked(image if sensor.mask is None else image * ~sensor.mask)
        found = merge_detections(self, detections, light, sensor, near_neighbors=near_neighbors)
        ones, trials, flags = found
        share = 1 / frames
        return Merged(ones, trials, sensor, flags=flags, light_share=share, valid_up_to=largest)

    def _rate(self, light: npt.ArrayLike) -> Array:
        levels = np.asarray(to_array("light", light), np.float64)
        if not (levels >= 0).all():
            raise ValueError(f"light: expected photons per exposure time, >= 0, got {shown(light)}")
        # Infinite light, the upper end of an interval, has the limits of all sums.
        return np.minimum(self.efficiency * levels + self.dark_counts, _SATURATED_RATE)

    def _checked(self, counts: npt.ArrayLike, beyond: int = 0) -> npt.NDArray[np.int64]:
        refuse_masked("counts", counts, _MASKED_ADVICE)
        values = to_array("counts", counts)
        if values.dtype.kind not in "iu":
            raise ValueError(
                f"counts: expected whole numbers, got {type_of(counts, values)}; cast rounded "
                "floats with astype(int)"
            )
        is_outside = (values < 0) | (values > self.max_count + beyond)
        if is_outside.any():
            raise ValueError(
                f"counts: expected whole numbers from 0 to {self.max_count}, the largest count "
                f"with a dead time of {self.dead_time:g} exposures, got {values[is_outside][0]}"
            )
        return values.astype(np.int64)
