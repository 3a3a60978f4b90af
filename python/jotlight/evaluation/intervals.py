"""Intervals of the intensity around the estimate of any method."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.errors import hide_warnings
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.error_scale import (
    ErrorModel,
    Half,
    HalfErrors,
    correction,
    divide_bits,
    error_model,
    expected_squares,
    is_unlikely,
)
from jotlight.layout import Layout
from jotlight.networks.network import Network
from jotlight.sensing.merged import Merged
from jotlight.sensing.pixel_counts import Estimate, GrayImages, PixelCounts
from jotlight.sensing.response import (
    Array,
    detection_probability,
    intensity_at_probability,
    silence_probability,
)
from jotlight.sensing.sensor import Sensor

MIN_TRIALS = 4
"""Minimum number of trials whose halves show errors; see `MIN_HELD_OUT`."""

TYPICAL_DEVIATION = 1.4
"""Root mean square of error/scale on photographs."""

_WINDOW = 7
"""Side of the window in which two estimates are compared, in pixels."""


def stabilize(
    intensity: Array, sensor: Sensor, efficiency: float | Array, dark_counts: float | Array
) -> Array:
    """Return z = arcsin √p of the probability p that a bit is 1.

    Parameters
    ----------
    intensity : ndarray, shape (H, W)
        Intensities of 0 or more.
    sensor : Sensor
        The sensor.
    efficiency, dark_counts : float or ndarray, shape (H, W)
        η and d of the pixels.

    Examples
    --------
    >>> stabilize(np.array([[0.0, np.log(2)]]), Sensor(), 1.0, 0.0).round(4)  # π/4
    array([[0.    , 0.7854]])
    """
    rate = efficiency * sensor.light_per_intensity * intensity + dark_counts
    p, rest = (
        detection_probability(sensor.threshold, rate),
        silence_probability(sensor.threshold, rate),
    )
    return np.asarray(np.arctan2(np.sqrt(p), np.sqrt(rest)))


def intensity_of(
    z: Array, sensor: Sensor, efficiency: float | Array, dark_counts: float | Array
) -> Array:
    """Return the intensity in [0, S] of z: the inverse of :func:`stabilize`."""
    z = np.clip(z, 0, np.pi / 2)
    p, complement = np.sin(z) ** 2, np.cos(z) ** 2
    slope = efficiency * sensor.light_per_intensity
    intensity = intensity_at_probability(sensor.threshold, p, complement, slope, dark_counts)
    return np.asarray(np.clip(intensity, 0, sensor.max_intensity))


@dataclasses.dataclass(frozen=True)
class Pixels:
    """The pixels of a gray image, (H, W)."""

    sensor: Sensor
    ones: npt.NDArray[np.int32]
    trials: Array
    efficiency: float | Array
    dark_counts: float | Array

    @classmethod
    def of(cls, pixels: PixelCounts, index: int) -> Self:
        """Return the pixels of one of N images."""
        trials = np.broadcast_to(np.asarray(pixels.trials, np.float64), pixels.counts.shape)
        efficiency, dark_counts = (
            value[index] if isinstance(value, np.ndarray) else value
            for value in (pixels.efficiency, pixels.dark_counts)
        )
        return cls(pixels.sensor, pixels.counts[index], trials[index], efficiency, dark_counts)

    def merged(self, ones: npt.NDArray[Any], trials: npt.NDArray[Any]) -> Merged:
        """Return some of the bits as data."""
        return Merged(
            ones.astype(np.int32),
            trials.astype(np.float64),
            self.sensor,
            dark_counts=self.dark_counts,
            efficiency=self.efficiency,
        )

    def stabilize(self, estimate: Estimate) -> Array:
        """Return z of an estimate."""
        jot = self.efficiency, self.dark_counts
        return stabilize(estimate.astype(np.float64), self.sensor, *jot)

    def errors(self, halves: Sequence[Half], estimates: Sequence[Estimate]) -> list[HalfErrors]:
        """Return the errors of the estimates from each half, if there are any."""
        pairs = (halves, halves[::-1])
        return [
            HalfErrors.measure(self.stabilize(estimate), *pair)
            for estimate, pair in zip(estimates, pairs[: len(estimates)], strict=True)
        ]

    def scale(self, known: Estimate, errors: list[HalfErrors], model: ErrorModel) -> Array:
        """Return the scale of the errors of a network's estimate, with those from the halves."""
        z, trials = self.stabilize(known), np.maximum(self.trials, 0.5)
        scale = model.scale(z, trials)
        if not errors:
            return scale
        return scale * correction(errors, [expected_squares(model, half) for half in errors], z)

    def uncertainty(
        self,
        estimate: Estimate,
        scale: Array,
        errors: list[HalfErrors],
        confidence_level: float,
        model: ErrorModel,
    ) -> Uncertainty:
        """Return the uncertainty (1, H, W) of an estimate whose errors have a scale."""
        z, trials = self.stabilize(estimate), np.maximum(self.trials, 0.5)

        def intensity(z: Array) -> Array:
            return intensity_of(z, self.sensor, self.efficiency, self.dark_counts)

        low, high = model.quantiles(z, trials, (1 - confidence_level) / 2)
        deviation = scale * model.deviations(z, trials)
        low, high = intensity(z + low * scale), intensity(z + high * scale)
        dead = self.trials == 0
        error = (intensity(z + deviation) - intensity(z - deviation)) / 2
        return Uncertainty(
            standard_error=error.astype(np.float32)[None],
            low=np.minimum(low, estimate).astype(np.float32)[None],
            high=np.maximum(high, estimate).astype(np.float32)[None],
            unlit=((low <= 0) & ~dead)[None],
            saturated=((self.ones == self.trials) & ~dead)[None],
            dead=dead[None],
            unlikely=(is_unlikely(errors) if errors else np.zeros_like(dead))[None],
            confidence_level=confidence_level,
        )


def find_intervals(
    images: GrayImages,
    estimates: Estimate,
    sensor: Sensor,
    network: Network,
    *,
    is_own: bool,
    confidence_level: float,
    threads: int | None,
) -> Uncertainty:
    """Return the uncertainty of the estimates of images, in units of intensity.

    Parameters
    ----------
    images : GrayImages
        The data of N images.
    estimates : ndarray of float32, shape (N, H, W)
        Estimates of any method.
    sensor : Sensor
        The sensor of the data.
    network : Network
        A K-conditioned network that serves the sensor.
    is_own : bool
        Whether the estimates are those of this network.
    confidence_level : float
        Coverage of the intervals.
    threads : int, optional
        Number of threads. Default: all.
    """
    results: list[Uncertainty] = []
    for part in images.parts(sensor):
        pixels = part.count(sensor, threads)
        each = [Pixels.of(pixels, index) for index in range(len(part))]
        halves = [divide_bits(one.ones, one.trials) for one in each]
        of_halves = estimate_halves(network, each, halves, threads)
        own = estimates[len(results) : len(results) + len(part)]
        known = own if is_own else _quietly(network, part, sensor, threads)
        for place, one in enumerate(each):
            errors = one.errors(halves[place], of_halves[place])
            scale = one.scale(known[place], errors, error_model())
            if not is_own:
                difference = one.stabilize(own[place]) - one.stabilize(known[place])
                scale = widen(scale, difference)
            results.append(
                one.uncertainty(own[place], scale, errors, confidence_level, error_model())
            )
    return Uncertainty.arrange(results, images.layout)


def estimate_halves(
    network: Network,
    pixels: Sequence[Pixels],
    halves: Sequence[Sequence[Half]],
    threads: int | None,
) -> list[Sequence[Estimate]]:
    """Return the estimates from each half of the bits of images, or none if they show no errors."""
    places = [i for i, one in enumerate(pixels) if np.median(one.trials) >= MIN_TRIALS]
    results: list[Sequence[Estimate]] = [[] for _ in pixels]
    if places:
        data = [
            pixels[place].merged(half.ones, half.trials)
            for place in places
            for half in halves[place]
        ]
        images = GrayImages(data, Layout((len(data),)))
        estimates = _quietly(network, images, pixels[0].sensor, threads)
        for index, place in enumerate(places):
            results[place] = list(estimates[2 * index : 2 * index + 2])
    return results


def _quietly(network: Network, images: GrayImages, sensor: Sensor, threads: int | None) -> Estimate:
    """Return the estimates (N, H, W) of a network without warnings, which the method issues."""
    images = dataclasses.replace(images, layout=Layout((len(images),)))
    with hide_warnings():
        return network.reconstruct(images, sensor, threads=threads)


def widen(scale: Array, difference: Array) -> Array:
    """Return the scale of a method's errors from that of the network, and their difference.

    The error of a network that minimizes the squared error is nearly orthogonal to every function
    of the data, and so to the difference. So the squares add up.
    """
    from scipy.ndimage import uniform_filter

    squared = uniform_filter(difference**2, _WINDOW, mode="mirror")
    return np.asarray(np.sqrt(scale**2 + squared / TYPICAL_DEVIATION**2))
