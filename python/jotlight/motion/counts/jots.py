"""The jots that pixels see while the scene moves.

Efficiencies and dark counts belong to the jots, and the scene moves over them. Where they differ,
the counts of a pixel also depend on the jots that have seen its scene point. A pattern of the
jots stands still, so it would draw an estimated motion toward 0 if it were taken for the scene.
"""

import dataclasses
from typing import Any, Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.motion.counts.lights import constant_light
from jotlight.sensing.likelihood.reference import Jot, reference_jot
from jotlight.sensing.parameters.response import detection_density, detection_probability
from jotlight.sensing.sensor import Sensor

_MIN_RATE = np.float32(1e-4)
"""Smallest expected number of detections of a jot in a frame."""

_MIN_COMPLEMENT = np.float32(1e-6)
"""Smallest probability that a jot reports 0."""


@dataclasses.dataclass(frozen=True, eq=False)
class Jots:
    """The efficiency and the dark counts of all jots, where these differ.

    Parameters
    ----------
    threshold : int
        q: the number of photons that make a jot report 1.
    reference : Jot
        η and d of the median jot, to which all counts are converted.
    maps : ndarray of float32, shape (3, H, W)
        η, d, and 1 for each jot; for q = 1, 1 - exp(-d) in place of d. All three are 0 for jots
        that are not counted.
    """

    threshold: int
    reference: Jot
    maps: Image

    @classmethod
    def of_sensor(
        cls, sensor: Sensor, size: tuple[int, int], valid: npt.NDArray[np.uint8] | None
    ) -> Self | None:
        """Return the jots of a sensor, or None if those that are counted are all alike.

        Parameters
        ----------
        sensor : Sensor
            The sensor.
        size : (int, int)
            H and W in jots.
        valid : ndarray of uint8, shape (H, ceil(W / 8)), optional
            Packed mask of the jots that are counted.
        """
        if not any(isinstance(value, np.ndarray) for value in sensor.maps().values()):
            return None
        maps = np.ones((3, *size), np.float32)
        dark_counts = np.asarray(sensor.dark_counts)
        # For q = 1, 1 - P is exp(-η s) exp(-d). So the mean of the second factor is exact.
        maps[1] = -np.expm1(-dark_counts) if sensor.threshold == 1 else dark_counts
        maps[0] = sensor.efficiency
        if valid is not None:
            maps *= np.unpackbits(valid, axis=1, count=size[1])
        counted = maps[:2, maps[2] > 0]
        if counted.size == 0 or not np.ptp(counted, axis=1).any():
            return None
        return cls(sensor.threshold, reference_jot(sensor), maps)

    def at_rest(self, trials: npt.NDArray[np.int32]) -> "SeenJots":
        """Return what pixels see that do not move."""
        return SeenJots(self, self.maps[:2] * trials)

    def along(
        self,
        trials: npt.NDArray[np.int32],
        fields: npt.NDArray[np.float32],
        tile: int | None,
        times: npt.NDArray[np.float64],
        threads: int | None,
    ) -> "SeenJots":
        """Return what pixels see along a motion, averaged over some frames.

        Parameters
        ----------
        trials : ndarray of int32, shape (H, W)
            Number of bits of each pixel.
        fields, tile, times
            The motion, as for :func:`jotlight._engine.count_shifted`.
        threads : int, optional
            The number of threads.
        """
        seen = np.zeros_like(self.maps)
        engine.add_shifted_values(self.maps, fields, tile, times, seen, threads)
        # A pixel may see counted jots only in frames that are not among these.
        is_unknown = (seen[2] == 0) & (trials > 0)
        for values, own in zip(seen, self.maps, strict=True):
            values[is_unknown] = own.sum() / max(float(self.maps[2].sum()), 1.0)
        return SeenJots(self, seen[:2] * (trials / np.maximum(seen[2], 1)).astype(np.float32))


@dataclasses.dataclass(frozen=True, eq=False)
class SeenJots:
    """Sums of the maps of the jots over the bits of each pixel.

    Parameters
    ----------
    jots : Jots
        The jots.
    sums : ndarray of float32, shape (2, H, W)
        Those of the efficiency, and of the dark counts.
    """

    jots: Jots
    sums: Image

    def __add__(self, other: "SeenJots") -> "SeenJots":
        return SeenJots(self.jots, self.sums + other.sums)

    def __mul__(self, factor: npt.NDArray[Any]) -> "SeenJots":
        return SeenJots(self.jots, self.sums * factor.astype(np.float32))

    def mean(self, trials: npt.NDArray[Any]) -> Image:
        """Return the mean η and d of each pixel, (2, H, W). Without bits, the median jot's.

        For q = 1, the mean of d is that with which as many bits are 1 as with the various d.
        """
        number = np.where(trials > 0, trials, 1).astype(np.float32)
        means: Image = self.sums / number
        if self.jots.threshold == 1:
            means[1] = -np.log(np.maximum(1 - means[1], _MIN_COMPLEMENT))
        for values, value in zip(means, self.jots.reference, strict=True):
            values[trials == 0] = value
        return means

    def response(self, trials: npt.NDArray[Any], probability: Image) -> tuple[Image, Image]:
        """Return the probability of a one at each pixel, and its derivative.

        Parameters
        ----------
        trials : ndarray, shape (H, W)
            Number of bits of each pixel.
        probability : ndarray of float32, shape (H, W)
            p: the probability that the median jot reports 1, above 0 and below 1.

        Returns
        -------
        probability, slope : ndarray of float32, shape (H, W)
            P(q, η s + d), with the mean η and d of the pixel and the light s that p shows, and its
            derivative with respect to p.
        """
        threshold, (efficiency, dark_counts) = self.jots.threshold, self.jots.reference
        of_reference = inverse_response(threshold, probability)
        light = (of_reference - np.float32(dark_counts)) / np.float32(efficiency)
        means = self.mean(trials)
        rate = np.maximum(means[0] * light + means[1], _MIN_RATE)
        expected, density = response(threshold, rate)
        slope = means[0] / np.float32(efficiency) * density / response(threshold, of_reference)[1]
        return expected, slope


def response(threshold: int, rate: Image) -> tuple[Image, Image]:
    """Return the detection probability P(q, s) and its derivative, in single precision.

    Examples
    --------
    >>> probability, density = response(1, np.float32([0.5]))
    >>> round(float(probability[0]), 4), round(float(density[0]), 4)
    (0.3935, 0.6065)
    """
    if threshold == 1:
        # The exponential function in single precision is much faster than the others.
        none = np.exp(-rate)
        return 1 - none, none
    probability, density = (
        detection_probability(threshold, rate),
        detection_density(threshold, rate),
    )
    return probability.astype(np.float32), density.astype(np.float32)


def inverse_response(threshold: int, probability: Image) -> Image:
    """Return the rate at which a jot reports 1 with a probability, in single precision.

    For q above 1, it is interpolated in a table.

    Examples
    --------
    >>> rates = np.float32([0.2, 1.0, 5.0])
    >>> bool(abs(inverse_response(3, response(3, rates)[0]) - rates).max() < 1e-3)
    True
    """
    if threshold == 1:
        return np.asarray(np.maximum(-np.log(1 - probability), _MIN_RATE))
    rates, probabilities, _ = constant_light(threshold)
    return np.asarray(np.interp(probability, probabilities, rates), np.float32)
