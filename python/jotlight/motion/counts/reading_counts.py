"""Readings as counts of single bits, for motion, and merged counts of them.

The alignment takes counts of bits that all show the scene alike. Two steps make such counts:

- The photons of a reading go into n short trials. A trial with photons is a one: L is binomial.
- The exposures of a bracket repeat in cycles of frames, such as short, long, short, long. The ones
  of a cycle are added, so that all sums show the scene alike.

Saturation, read noise, and differences of exposures change the mean and the variance of the ones.
They do not matter for the motion, and merged counts are corrected for them.
"""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.merge_readings import join_channels, linear_counts
from jotlight.estimators.readings.neighbors import average_fractions, toward_own
from jotlight.estimators.readings.reference_sensors import (
    light_share,
    reference_dark_counts,
    reference_sensor,
)
from jotlight.estimators.readings.whole_counts import whole_counts
from jotlight.formats.capture import CountStack
from jotlight.kept import kept_property
from jotlight.motion.counts.reading_response import Response
from jotlight.motion.motion import Motion
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.alike_frames import exposure_cycle
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor

_TRIALS_PER_PHOTON = 4
"""Number of trials per photon of a bright reading. Few photons then share a trial."""

_MIN_DIGITS, _MAX_DIGITS = 4, 12
"""Range of the number of binary digits of a count. The time grows in proportion to them."""

_BRIGHT = 0.999
"""Fraction of the readings that are at most a bright one."""

_CENTRAL = 32
"""Number of frames, in the middle, whose readings show how bright the scene is."""

_SEED = 2027
"""Seed of the rounding, so that each frame has the same counts whenever it is read."""


class ReadingStack(CountStack):
    """Counts of readings. The threshold of their sensor is nominal: their ones do not follow it."""


@dataclasses.dataclass(frozen=True)
class ReadingCounts:
    """Readings of several bits, or of a bracket of exposures, as counts of single bits.

    Parameters
    ----------
    readings : Bits or Readings
        The readings, (T, H, W) or (T, H, W, C).
    stated : Sensor
        Their sensor.
    cycle : int
        The number of frames after which gains and thresholds repeat.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=32, bit_depth=6, gain=64.0)
    >>> readings = sensor.expose(np.full((8, 8), 0.5), rng=0)
    >>> converted = ReadingCounts(readings, sensor)
    >>> converted.trials, converted.sensor
    (31, Sensor(frames=992, gain=64.0))
    >>> bracket = jl.Sensor(frames=32, gain=[1.0, 7.0] * 16)
    >>> converted = ReadingCounts(bracket.expose(np.full((8, 8), 0.5), rng=0), bracket, 2)
    >>> len(converted.counts), converted.counts.trials, converted.sensor
    (16, 2, Sensor(frames=32, gain=128.0))
    """

    readings: Bits | Readings
    stated: Sensor
    cycle: int = 1

    @property
    def is_mergeable(self) -> bool:
        """Whether the counts can be merged along a motion: those of pixels of one jot."""
        return self.stated.oversampling == 1

    @kept_property
    def _bright(self) -> int:
        """A reading that few others exceed, in photons."""
        start = max(0, (len(self.readings) - _CENTRAL) // 2)
        middle = self.readings[start : start + _CENTRAL].to_array()
        return max(1, int(np.quantile(middle, _BRIGHT)))

    @kept_property
    def trials(self) -> int:
        """The number n of trials behind a reading: 1 for bits, or 2^m - 1 for m digits."""
        if self.stated.bit_depth == 1:
            return 1
        digits = (_TRIALS_PER_PHOTON * self._bright - 1).bit_length()
        return (1 << min(max(digits, _MIN_DIGITS), _MAX_DIGITS)) - 1

    @kept_property
    def sensor(self) -> Sensor:
        """A sensor of all counts, whose bits show the scene about alike on average."""
        threshold, frames = np.unique(self.stated.threshold), len(self.counts) * self.cycle
        return self.stated.replace(
            frames=frames * self.trials,
            gain=self._mean_gain * frames,
            threshold=int(threshold[0]) if len(threshold) == 1 else 1,
            bit_depth=1,
            read_noise=0.0,
            dark_counts=self.stated.dark_counts / self.trials,
        )

    @kept_property
    def _mean_gain(self) -> float:
        """The mean gain of a frame of a cycle. An incomplete cycle at the end does not count."""
        gain = np.asarray(self.stated.gain)
        return float(gain[: self.cycle].mean() if gain.ndim else gain / len(self.readings))

    @kept_property
    def counts(self) -> ReadingStack:
        """The number of ones of each cycle, as a stack that computes them when they are read."""
        trials = self.cycle * self.trials
        number = len(self.readings) // self.cycle
        dtype = np.min_scalar_type(trials)
        frames = Frames((number, *self.readings.shape[1:]), self._read, dtype)
        provenance = self.readings.provenance or Provenance("readings", "readings")
        return ReadingStack(frames, provenance, trials)

    @kept_property
    def _ones(self) -> Array:
        """The mean number of ones of each reading that occurs, n (1 - (1 - 1/n)^r)."""
        readings = np.arange(self.stated.max_reading + 1)
        if self.trials == 1:
            return readings.astype(np.float64)
        return np.asarray(-self.trials * np.expm1(readings * np.log1p(-1 / self.trials)))

    def _read(self, start: int, stop: int) -> npt.NDArray[np.unsignedinteger]:
        """Return the counts of some cycles."""
        number, frames = stop - start, range(self.cycle * start, self.cycle * stop)
        dtype = self.counts.images.dtype
        if self.trials == 1:
            bits = self.readings[frames.start : frames.stop].to_array()
            cycles = bits.reshape(number, self.cycle, *bits.shape[1:])
            return np.asarray(cycles.sum(axis=1, dtype=dtype))
        counts = np.zeros((number, *self.readings.shape[1:]), dtype)
        for index, frame in enumerate(frames):
            counts[index // self.cycle] += self._ones_of(frame)
        return counts

    def _ones_of(self, frame: int) -> npt.NDArray[np.uint16]:
        """Return the ones of a frame. Means are rounded at random, so they have no bias."""
        readings = self.readings[frame : frame + 1].to_array()[0]
        noise = np.random.default_rng((_SEED, frame)).random(readings.shape, np.float32)
        return np.asarray((self._ones.astype(np.float32)[readings] + noise).astype(np.uint16))

    @kept_property
    def responses(self) -> list[tuple[float, Response]]:
        """The light of each frame of a cycle in units of the mean one, and its response."""
        gain = np.broadcast_to(self.stated.gain, len(self.readings))[: self.cycle]
        threshold = np.broadcast_to(self.stated.threshold, len(self.readings))[: self.cycle]
        bright = self._bright if self.stated.bit_depth > 1 else None
        of_threshold = {
            int(each): Response.of(self.stated, int(each), self.trials, self._ones, bright)
            for each in np.unique(threshold)
        }
        return [
            (float(share), of_threshold[int(each)])
            for share, each in zip(gain / gain.mean(), threshold, strict=True)
        ]

    def _of_cycle(self, light: Array, dark_counts: float | Array) -> list[Array]:
        """Return the mean and the variance of the fraction of ones of a cycle, and the slope.

        Parameters
        ----------
        light : ndarray of float
            The light of a frame, the mean over a cycle, in detected photons.
        dark_counts : float or ndarray of float
            The dark counts of a frame.
        """
        parts = [
            (share, response.at(share * light + dark_counts)) for share, response in self.responses
        ]
        number = len(parts)
        mean = sum(part[0] for _, part in parts) / number
        variance = sum(part[1] for _, part in parts) / number**2
        slope = sum(share * part[2] for share, part in parts) / number
        return [np.asarray(each) for each in (mean, variance, slope)]

    def _light(self, fraction: Array, dark_counts: float) -> Array:
        """Return the light at which the fraction of ones of a cycle is expected."""
        light = np.unique(
            np.concatenate([response.rates / share for share, response in self.responses])
        )
        mean = np.maximum.accumulate(self._of_cycle(light, dark_counts)[0])
        return np.asarray(np.interp(fraction, mean, light))

    def _light_of_neighbors(
        self, ones: npt.NDArray[np.number], trials: Array, dark_counts: float | Array
    ) -> Array:
        """Return the light at which the ones of each pixel and its neighbors are expected."""
        typical = float(np.median(dark_counts))
        light = self._light(average_fractions(ones, trials), typical)
        if np.ndim(dark_counts) == 0:
            return light
        # Ones from dark counts above the typical ones do not come from light.
        excess = self._of_cycle(light, dark_counts)[0] - self._of_cycle(light, typical)[0]
        return self._light(average_fractions(ones - trials * excess, trials), typical)

    def correct(self, merged: Merged, threads: int | None = None) -> Merged:
        """Return merged counts whose likelihood near averages of neighbors is that of the readings.

        Parameters
        ----------
        merged : Merged
            Counts of :attr:`counts` along a motion.
        threads : int, optional
            Number of threads. Default: all.
        """
        channels = [self._correct(each, threads) for each in merged.channels()]
        return channels[0] if merged.ones.ndim == 2 else join_channels(channels)

    def _correct(self, merged: Merged, threads: int | None) -> Merged:
        gray = without_mosaic(self.stated)
        reference = reference_sensor(gray)
        trials = np.broadcast_to(np.asarray(merged.trials, np.float64), merged.shape)
        known = trials > 0
        fraction = np.where(known, merged.ones / np.where(known, trials, 1), 0.0)
        dark = merged.dark_counts * self.trials
        near = self._light_of_neighbors(merged.ones, trials, dark)
        mean, variance, slope = self._of_cycle(near, dark)
        # The most likely light of a pixel, to first order.
        own = np.maximum(near + (fraction - mean) / np.maximum(slope, 1e-9), 0)
        readings = trials / (self.trials * self.cycle)
        light = toward_own(near, own, readings * slope**2 / np.maximum(variance, 1e-12))
        mean, variance, slope = self._of_cycle(light, dark)
        slope = np.maximum(slope, 1e-9)
        weight = readings * slope / np.maximum(variance, 1e-12)
        # A jot of the reference sensor gets this light, in units of that of a frame.
        share = reference.light_per_intensity / self._mean_gain
        floor = reference_dark_counts(gray, reference, dark)
        rate = np.maximum(share * light + floor, 1e-9)
        gradient, information = weight * (fraction - mean), weight * slope
        threshold = int(reference.threshold)
        ones, number = linear_counts(gradient, information, share, rate, rate, threshold)
        ones, number = (np.where(known, part, 0.0) for part in (ones, number))
        whole, number = whole_counts(ones, number, threads=threads)
        return dataclasses.replace(
            merged,
            ones=whole,
            trials=number,
            dark_counts=floor,
            sensor=reference,
            light_share=light_share(gray, reference),
        )

    @property
    def middle(self) -> float:
        """The time of the first count: the middle of the first cycle, in frames."""
        return (self.cycle - 1) / 2

    def in_cycles(self, motion: Motion) -> Motion:
        """Return a motion of frames as that of counts, whose times are numbers of cycles."""
        return dataclasses.replace(
            motion,
            times=(motion.times - self.middle) / self.cycle,
            reference=(motion.reference - self.middle) / self.cycle,
        )

    def frames_of(self, cycles: list[range]) -> list[range]:
        """Return spans of cycles as spans of frames."""
        return [range(self.cycle * span.start, self.cycle * span.stop) for span in cycles]

    def in_frames(self, motion: Motion) -> Motion:
        """Return a motion of counts as that of frames. The inverse of :meth:`in_cycles`."""
        return dataclasses.replace(
            motion,
            times=self.cycle * motion.times + self.middle,
            reference=self.cycle * motion.reference + self.middle,
        )


def counts_of_readings(data: object, sensor: object) -> ReadingCounts | None:
    """Return readings other than plain bits as counts of single bits, or None for other data.

    Parameters
    ----------
    data : Bits, CountStack, or Readings
        T frames.
    sensor : Sensor or None
        Their sensor. Default: the one of the data.

    Raises
    ------
    ValueError
        When exposures do not repeat in cycles.
    """
    if not isinstance(data, Bits | Readings | CountStack):
        return None
    stated: Any = sensor
    if stated is None:
        stated = carried_sensor(data) if isinstance(data, Bits) else data.sensor
    if not isinstance(stated, Sensor) or without_mosaic(stated).has_plain_bits:
        return None
    if np.ndim(stated.threshold) == 2:
        return None  # its jots are of several kinds
    if stated.bit_depth == 1 and not isinstance(data, Bits):
        return None
    cycle = exposure_cycle(stated)
    if isinstance(data, Bits):
        check_fits(data.shape, stated)
        return ReadingCounts(data, stated, cycle)
    if isinstance(data, CountStack):
        return ReadingCounts(data.readings(stated), stated, cycle)
    return ReadingCounts(Readings(data.frames, stated, data.provenance), stated, cycle)


def counts_for_motion(data: object, sensor: object) -> ReadingCounts | None:
    """Return what :func:`counts_of_readings` returns if its counts can be merged along a motion.

    Raises
    ------
    ValueError
        Also when pixels have several jots.
    """
    converted = counts_of_readings(data, sensor)
    if converted is None or converted.is_mergeable:
        return converted
    raise ValueError(
        "sensor: expected pixels of one jot for the motion in brackets, in readings of several "
        f"bits, or with read noise, got an oversampling of {converted.stated.oversampling}; "
        "jotlight.reconstruct makes one image of all frames"
    )
