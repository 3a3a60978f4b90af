"""The pixels of a gray image, the scale of the errors of their estimates, and their intervals."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.blur import blur
from jotlight.estimators.trial_levels import count_local_trials
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.intervals.contrast import Contrast
from jotlight.evaluation.intervals.error_scale import (
    ErrorModel,
    Half,
    HalfErrors,
    correction,
    expected_squares,
    gray_scale,
)
from jotlight.evaluation.intervals.known_errors import KnownErrors
from jotlight.evaluation.intervals.stabilized import intensity_of, slope_of, stabilize
from jotlight.evaluation.intervals.unlikely import find_contradictions
from jotlight.kept import kept_property
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.likelihood.reference import Jot, typical_jot
from jotlight.sensing.merged import MAX_SILENT_TRIALS, Merged
from jotlight.sensing.parameters.binomial import upper_tail
from jotlight.sensing.parameters.response import (
    detection_probability,
)
from jotlight.sensing.sensor import Sensor

_MIN_TRIALS = 0.5
"""Smallest number of trials for which a scale is computed."""

_LIVE_SIGMA = 3.0
"""Standard deviation of the window in which live pixels are counted, in pixels."""

_MIN_LIGHT = 1e-4
"""Smallest intensity at which jots are compared, as a fraction of the largest one, or of ten times
the mean estimate if that is smaller."""

_MAX_RATIO = 8.0
"""Largest derivative of z at a jot with respect to z at another one.

Beyond it, one of them is dark or saturated.
"""

_MIN_BITS = 50
"""Number of bits around a pixel that bound its intensity from above, if one of them is 0.

If all of them are 1, the probability of a one is at least 0.94, with a confidence of 95 %."""

_MIN_SIDE = 3
"""Smallest side of the square of these bits, in pixels."""


def find_unbounded(
    total: npt.NDArray[Any], largest: npt.NDArray[Any], trials: npt.NDArray[Any]
) -> npt.NDArray[np.bool_]:
    """Return whether all readings around each pixel are the largest one.

    The light of the pixel may then be of any brightness. The network has seen no photographs of
    such light, so its errors do not bound it, either.

    Parameters
    ----------
    total, largest : ndarray, shape (H, W)
        The sum of the readings of each pixel, and the largest possible one.
    trials : ndarray, shape (H, W)
        Their number.
    """
    from scipy.ndimage import maximum_filter

    if not (typical := np.median(trials)):
        return np.zeros(total.shape, np.bool_)
    side = max(math.ceil(math.sqrt(_MIN_BITS / typical)) // 2 * 2 + 1, _MIN_SIDE)
    has_light, has_less = (maximum_filter(each, side) for each in (total > 0, total < largest))
    return np.asarray(has_light & ~has_less)


def min_deviation(trials: Array) -> float:
    """Return the standard deviation of z from all trials of an image, if all pixels are alike.

    A network sees an image that is continued beyond its border. So it is too certain of one with a
    few pixels only.

    Examples
    --------
    >>> min_deviation(np.full((5, 5), 16.0))
    0.025
    """
    return float(1 / (2 * np.sqrt(trials.sum())))


@dataclasses.dataclass(frozen=True)
class Pixels:
    """The pixels of a gray image, (H, W).

    Errors are those of z at the *typical jot*, with the median efficiency and dark counts. At the
    own jot of each pixel, z would have a pattern that looks like a scene full of detail.
    """

    sensor: Sensor
    ones: npt.NDArray[np.int32]
    trials: Array
    efficiency: float | Array
    dark_counts: float | Array
    threads: int | None = None

    @classmethod
    def of(cls, pixels: PixelCounts, index: int, threads: int | None = None) -> Self:
        """Return the pixels of one of N images."""
        trials = np.broadcast_to(np.asarray(pixels.trials, np.float64), pixels.counts.shape)
        efficiency, dark_counts = (
            value[index] if isinstance(value, np.ndarray) else value
            for value in (pixels.efficiency, pixels.dark_counts)
        )
        jot = efficiency, dark_counts
        return cls(pixels.sensor, pixels.counts[index], trials[index], *jot, threads)

    def merged(self, ones: npt.NDArray[Any], trials: npt.NDArray[Any]) -> Merged:
        """Return some of the bits as data."""
        return Merged(
            ones.astype(np.int32),
            trials.astype(np.float64),
            self.sensor,
            dark_counts=self.dark_counts,
            efficiency=self.efficiency,
        )

    @kept_property
    def typical_jot(self) -> Jot:
        """η and d of the typical jot."""
        return typical_jot(self.trials, self.efficiency, self.dark_counts)

    @property
    def has_alike_jots(self) -> bool:
        """Whether the jots of all pixels are alike."""
        return not any(isinstance(each, np.ndarray) for each in (self.efficiency, self.dark_counts))

    @kept_property
    def unbounded(self) -> npt.NDArray[np.bool_]:
        """Whether the light of each pixel may be of any brightness: see :func:`find_unbounded`."""
        return find_unbounded(self.ones, self.trials, self.trials)

    def stabilize(self, estimate: Image) -> Array:
        """Return z of an estimate, at the typical jot."""
        return stabilize(estimate.astype(np.float64), self.sensor, *self.typical_jot)

    def local_trials(self, trials: Array, slope: float | Array) -> Array:
        """Return the trials of the typical jot with the information of those around each pixel.

        The network denoises with the trials around a pixel, so they determine its errors. Pixels
        without trials tell it nothing, so they count as zeros.

        Parameters
        ----------
        trials : ndarray, shape (H, W)
            Trials of the pixels.
        slope : float or ndarray, shape (H, W)
            :meth:`relative_slope` of the pixels.
        """
        equivalent = trials * np.square(slope)
        if np.ptp(equivalent) == 0:
            return np.maximum(equivalent, _MIN_TRIALS)
        counted = PixelCounts(self.sensor, self.ones[None], equivalent[None], 1.0, 0.0, False)
        (local,) = count_local_trials(counted, self.threads)
        live = blur((trials > MAX_SILENT_TRIALS).astype(np.float32), _LIVE_SIGMA, self.threads)
        return np.maximum(np.asarray(local, np.float64) * live, _MIN_TRIALS)

    def relative_slope(self, estimate: Image) -> float | Array:
        """Return the derivative of z at a pixel's own jot with respect to z at the typical jot.

        It is an array (H, W), or 1.0 if all jots are alike. Its square is the ratio of what a trial
        of both jots says about the light.
        """
        if self.has_alike_jots:
            return 1.0
        light, largest = estimate.astype(np.float64), self.sensor.max_intensity
        largest = min(largest, 10 * float(light.mean())) or largest
        light = np.maximum(light, _MIN_LIGHT * largest)
        own, typical = (
            slope_of(light, self.sensor, *jot)
            for jot in ((self.efficiency, self.dark_counts), self.typical_jot)
        )
        # Without light, both are 0.
        ratio = np.divide(own, typical, out=np.ones_like(own), where=typical > 0)
        return np.clip(ratio, 1 / _MAX_RATIO, _MAX_RATIO)

    def errors(self, halves: Sequence[Half], estimates: Sequence[Image]) -> list[HalfErrors]:
        """Return the errors of the estimates from each half, if there are any."""
        pairs = (halves, halves[::-1])
        found = []
        for estimate, pair in zip(estimates, pairs[: len(estimates)], strict=True):
            own = stabilize(
                estimate.astype(np.float64), self.sensor, self.efficiency, self.dark_counts
            )
            measured, slope = HalfErrors.measure(own, *pair), self.relative_slope(estimate)
            found.append(
                dataclasses.replace(
                    measured,
                    z=self.stabilize(estimate),
                    trials=self.local_trials(pair[0].trials.astype(np.float64), slope),
                    slope=measured.slope * slope,
                    relative_slope=slope,
                )
            )
        return found

    def known_errors(
        self, estimate: Image, halves: list[HalfErrors], model: ErrorModel
    ) -> KnownErrors:
        """Return the errors of a network's estimate, with those from the halves."""
        pixel = self._pixel_of(estimate)
        contrast = Contrast.of(int(self.sensor.threshold), *pixel, np.median(self.dark_counts))
        scale = gray_scale(model, *pixel, contrast)
        if halves:
            expected = [expected_squares(model, half, contrast) for half in halves]
            scale = scale * correction(halves, expected, pixel[0])
        return KnownErrors(estimate, scale, halves, model)

    def _find_unlit(self, places: npt.NDArray[np.bool_], tail: float) -> npt.NDArray[np.bool_]:
        """Return at which of the places dark counts explain the ones of a pixel.

        At other places, ones are evidence of light, even if the interval begins at 0. The error of
        a network may exceed the estimate there, such as beside a lamp or at a moving edge.
        """
        dark = detection_probability(self.sensor.threshold, np.asarray(self.dark_counts))
        ones, trials = self.ones[places], self.trials[places]
        dark = np.broadcast_to(dark, places.shape)[places]
        unlit = np.zeros_like(places)
        unlit[places] = upper_tail(ones, trials - ones, dark) >= tail
        return unlit

    def _pixel_of(self, estimate: Image) -> tuple[Array, Array]:
        """Return z of a network's estimate, and the local trials."""
        slope = self.relative_slope(estimate)
        return self.stabilize(estimate), self.local_trials(self.trials, slope)

    def uncertainty(
        self,
        estimate: Image,
        known: KnownErrors,
        confidence_level: float,
        unbounded: npt.NDArray[np.bool_] | None = None,
    ) -> Uncertainty:
        """Return the uncertainty (1, H, W) of an estimate.

        The estimate of the network behind the `known` errors states the class of each pixel. Where
        the light is `unbounded`, by default as in :attr:`unbounded`, intervals end at S.
        """
        unlikely, scales = np.zeros(self.trials.shape, np.bool_), [known.scale] * 2
        if known.halves:
            limit = np.full(self.trials.shape, self.sensor.max_intensity)
            largest = stabilize(limit, self.sensor, self.efficiency, self.dark_counts)
            unlikely, squared = find_contradictions([each.below(largest) for each in known.halves])
            scales = [known.at_least(each).scale for each in squared]
        model, z, pixel = known.model, self.stabilize(estimate), self._pixel_of(known.estimate)
        unbounded = self.unbounded if unbounded is None else unbounded

        from scipy.special import ndtri

        def intensity(z: Array) -> Array:
            return intensity_of(z, self.sensor, *self.typical_jot)

        tail = (1 - confidence_level) / 2
        quantiles = model.quantiles(*pixel, tail)
        low, high = (scale * each for scale, each in zip(scales, quantiles, strict=True))
        smallest = min_deviation(pixel[1])
        deviation = np.maximum(np.maximum(*scales) * model.deviations(*pixel), smallest)
        half_width = -smallest * ndtri(tail)
        low, high = np.minimum(low, -half_width), np.maximum(high, half_width)
        low, high = intensity(z + low), intensity(z + high)
        high = np.where(unbounded, self.sensor.max_intensity, high)
        dead = self.trials == 0
        error = (intensity(z + deviation) - intensity(z - deviation)) / 2
        return Uncertainty(
            standard_error=error.astype(np.float32)[None],
            low=np.minimum(low, estimate).astype(np.float32)[None],
            high=np.maximum(high, estimate).astype(np.float32)[None],
            unlit=self._find_unlit((low <= 0) & ~dead, tail)[None],
            saturated=((self.ones == self.trials) & ~dead)[None],
            dead=dead[None],
            unlikely=unlikely[None],
            confidence_level=confidence_level,
        )
