"""The likelihood of readings that a count of ones does not describe, about the intensity.

Readings with the same gain and threshold are a group. The counts of its bits have the likelihood of
:mod:`jotlight.sensing.likelihood.likelihood`, and readings of several bits or with read noise that
of :mod:`jotlight.sensing.likelihood.multibit`. All readings of a pixel see the same intensity, so
the joint log-likelihood is the sum of those of the groups.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array, Counts
from jotlight.checks import check_threads
from jotlight.kept import kept_property
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.bits.counting import count_ones
from jotlight.sensing.bits.frames import read_in_chunks
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.pixel_counts import (
    GrayData,
    PixelCounts,
    count_pixels,
    describe_pixels,
)
from jotlight.sensing.likelihood.joint_term import Term
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.likelihood.multibit import ReadingLikelihood
from jotlight.sensing.likelihood.reading_samples import Sample, require_readings, sample_readings
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.maps import pixel_means
from jotlight.sensing.parameters.reading_groups import ReadingGroup, frames_differ
from jotlight.sensing.sensor import Sensor
from jotlight.underflow import underflows_to_0


@dataclasses.dataclass(frozen=True)
class JointLikelihood:
    """The log-likelihood of all readings of a gray image, a function of the intensities (H, W).

    It is the sum over the groups of the log-likelihood ℓ of equation (4) at the light of the group.
    It is concave, and so it has one maximum.
    """

    sensor: Sensor
    terms: tuple[Term, ...]
    threads: int | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W), in pixels."""
        term = self.terms[0]
        height, width = term.shape
        return height // term.side, width // term.side

    @property
    def uniform(self) -> bool:
        """Whether all pixels have the same trials, efficiency, and dark counts."""
        return all(term.uniform for term in self.terms)

    @kept_property
    def total(self) -> Array:
        """The sum of all readings of each pixel; for bits, the number of ones."""
        return self._sum(lambda term: term.total)

    @kept_property
    def trials(self) -> Array:
        """The number of readings of each pixel, in all groups."""
        return self._sum(lambda term: term.trials)

    @kept_property
    def max_total(self) -> Array:
        """The largest possible sum of the readings of each pixel; for bits, their number."""
        return self._sum(lambda term: term.max_reading * term.trials)

    def value(self, intensity: npt.ArrayLike) -> float:
        """Return the log-likelihood in nats, summed over all pixels."""
        values = self._intensity(intensity)
        return sum(term.cells.value(term.spread(values)) for term in self.terms)

    @underflows_to_0
    def gradient_and_curvature(self, intensity: npt.ArrayLike) -> tuple[Array, Array]:
        """Return the first derivative and minus the second one, about the intensity of each pixel.

        Examples
        --------
        >>> sensor = jl.Sensor(frames=2, gain=[0.5, 1.5])
        >>> bits = jl.Bits.from_array([[[1]], [[0]]])
        >>> gradient, curvature = joint_likelihood(bits, sensor, None).gradient_and_curvature(1.0)
        >>> gradient.round(4).tolist(), curvature.round(4).tolist()  # 0.5 / (exp(0.5) - 1) - 1.5
        ([[-0.7293]], [[0.9794]])
        """
        values = self._intensity(intensity)
        gradient, curvature = np.zeros(self.shape), np.zeros(self.shape)
        for term in self.terms:
            first, second = term.cells.gradient_and_curvature(term.spread(values))
            # Near intensity 0, the curvature may exceed all numbers.
            with np.errstate(over="ignore"):
                gradient += term.light * term.sum_pixels(first)
                curvature += term.light**2 * term.sum_pixels(second)
        return gradient, curvature

    def maximum(self, start: Array, offset: float) -> Array:
        """Return the intensities in [0, S] with the highest likelihood, (H, W).

        `start` is a first guess, and `offset` the intensity that equals the dark counts. Pixels
        without readings are 0.
        """
        found = np.array(start, np.float64).reshape(-1)
        highest = self.sensor.max_intensity
        engine.joint_maximum(self._terms(), self.shape, highest, offset, found, self.threads)
        return found.reshape(self.shape)

    def solve_expected_total(self, total: Array, start: Array, offset: float) -> Array:
        """Return the intensities in [0, S] at which sums of readings are expected, (H, W)."""
        found = np.array(start, np.float64).reshape(-1)
        wanted = np.ascontiguousarray(total, np.float64).reshape(-1)
        highest = self.sensor.max_intensity
        engine.joint_solution(
            self._terms(), self.shape, wanted, highest, offset, found, self.threads
        )
        return found.reshape(self.shape)

    def _terms(self) -> list[Any]:
        return [term.engine_argument() for term in self.terms]

    def information(self, intensity: npt.ArrayLike) -> Array:
        """Return the Fisher information of the readings of each pixel about its intensity."""
        values = self._intensity(intensity)
        return self._sum(lambda term: term.light**2 * term.cells.information(term.spread(values)))

    def expected_total(self, intensity: Array) -> tuple[Array, Array, Array]:
        """Return the expected sum of the readings of each pixel, its derivative, and its variance.

        In a uniform image, any shape is allowed.
        """
        each = [term.expected_total(intensity) for term in self.terms]
        total, slope, variance = (np.asarray(sum(values)) for values in zip(*each, strict=True))
        return total, slope, variance

    def _sum(self, function: Any) -> Array:
        total = np.zeros(self.shape)
        for term in self.terms:
            total += term.sum_pixels(function(term))
        return total

    def _intensity(self, intensity: npt.ArrayLike) -> Array:
        return np.broadcast_to(np.asarray(intensity, np.float64), self.shape)


def joint_likelihood(data: GrayData, sensor: Sensor, threads: int | None) -> JointLikelihood:
    """Return the likelihood of the readings of a gray image.

    Parameters
    ----------
    data : Bits or Readings of shape (T, H·K̂, W·K̂), or ndarray of int32 (H, W)
        Bits, or readings of several bits; or counts, if every jot has the same readings in all
        frames and is a pixel.
    sensor : Sensor
        The sensor of the data. A smooth kernel is treated as the box kernel.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Raises
    ------
    TypeError, ValueError
        When the data and the sensor do not fit together, or counts do not say which readings are 1.
    """
    check_threads(threads)
    groups = sensor.groups()
    if isinstance(data, Merged):
        raise TypeError(
            "data: expected bits, because merged counts do not say which readings are 1, and these "
            "differ in their gain or threshold; pass the bits, or a sensor with one of each"
        )
    varies = any(
        pixel_means(value, group.sensor.mask, sensor.oversampling)[1]
        for group in groups
        for value in (sensor.efficiency, sensor.dark_counts)
    )
    side = sensor.oversampling if varies else 1
    if isinstance(data, Readings) or sensor.bit_depth > 1:
        readings = require_readings(data, sensor)
        samples = sample_readings(readings, groups, sensor.oversampling // side)
        terms = zip(samples, groups, strict=True)
        return JointLikelihood(
            sensor,
            tuple(_reading_term(one, group.sensor, side, threads) for one, group in terms),
            threads,
        )
    if isinstance(data, Bits):
        check_fits(data.shape, sensor)
        counts: Sequence[Counts] = _count_groups(data, groups, sensor.oversampling // side, threads)
    else:
        _check_counts(data, sensor, varies=varies)
        counts = [count_pixels(data, group.sensor, threads).counts for group in groups]
    return JointLikelihood(
        sensor,
        tuple(
            _term(ones, group.sensor, side, threads)
            for ones, group in zip(counts, groups, strict=True)
        ),
        threads,
    )


def _term(ones: Counts, sensor: Sensor, side: int, threads: int | None) -> Term:
    """Return the term of a group of bits, whose sensor has one gain and one threshold."""
    light = sensor.light_per_intensity
    if side > 1:
        sensor = sensor.replace(oversampling=1)
    pixels = describe_pixels(ones, sensor)
    live = _live_cells(pixels)
    counts, trials, efficiency, dark_counts = (
        _select_live(value, live)
        for value in (pixels.counts, pixels.trials, pixels.efficiency, pixels.dark_counts)
    )
    if sensor.read_noise:
        sample = np.stack([np.asarray(trials - counts, np.int32), counts], axis=-1)
        response = sensor.jot_response()
        noisy = ReadingLikelihood(response, sample, True, efficiency, dark_counts, threads)
        return Term(noisy, light, side, live)
    cells = Likelihood(
        counts,
        trials,
        threshold=sensor.threshold,
        efficiency=efficiency,
        dark_counts=dark_counts,
        threads=threads,
    )
    return Term(cells, light, side, live)


def _reading_term(sample: Sample, sensor: Sensor, side: int, threads: int | None) -> Term:
    """Return the term of a group of readings of several bits."""
    light = sensor.light_per_intensity
    if side > 1:
        sensor = sensor.replace(oversampling=1)
    pixels = describe_pixels(np.zeros(sample.values.shape[:-1], np.int32), sensor)
    live = _live_cells(pixels)
    values, efficiency, dark_counts = (
        _select_live(value, live)
        for value in (sample.values, pixels.efficiency, pixels.dark_counts)
    )
    cells = ReadingLikelihood(
        sensor.jot_response(), values, sample.is_histogram, efficiency, dark_counts, threads
    )
    return Term(cells, light, side, live)


def _live_cells(pixels: PixelCounts) -> npt.NDArray[np.bool_] | None:
    """Return the cells with readings, or None if all or none have some."""
    dead = pixels.dead_pixels
    return None if dead is None or dead.all() else ~dead


def _select_live(value: Any, live: npt.NDArray[np.bool_] | None) -> Any:
    """Return the values of live cells. A number is that of all cells."""
    return value[live] if live is not None and isinstance(value, np.ndarray) else value


def _count_groups(
    bits: Bits, groups: Sequence[ReadingGroup[Sensor]], oversampling: int, threads: int | None
) -> list[Counts]:
    """Return the number of ones of each group in squares of jots. The frames are read once."""
    size = (bits.shape[1] // oversampling, bits.shape[2] // oversampling)
    counts = [np.zeros(size, np.int32) for _ in groups]
    for frames, part in read_in_chunks(bits.packed):
        for group, ones in zip(groups, counts, strict=True):
            inside = group.frames[(group.frames >= frames.start) & (group.frames < frames.stop)]
            if len(inside):
                own = Bits(np.asarray(part)[inside - frames.start], bits.width)
                ones += count_ones([own], oversampling, group.sensor.mask, threads)[0]
    return counts


def _check_counts(counts: Counts, sensor: Sensor, *, varies: bool) -> None:
    """Raise ValueError unless counts say which readings are 1.

    They do so if all readings are alike, and if each pixel is a jot with one gain and threshold.
    """
    differ = sensor.readings_differ
    if varies or (differ and (sensor.oversampling > 1 or frames_differ(sensor))):
        names = "gain or threshold" if differ else "efficiency or dark counts"
        raise ValueError(
            f"counts: expected bits, because the readings of a pixel differ in their {names}, and "
            "a count does not say which of them are 1; pass the bits"
        )
    if differ:
        sensor.check_map_shapes(*counts.shape)
