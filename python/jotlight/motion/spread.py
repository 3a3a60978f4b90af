"""Readings of several bits as counts of single bits, for motion, and merged counts of them.

The alignment takes counts of bits, whose probabilities follow from one rate. So the photons of a
reading are spread over n short trials. A trial with a photon is a one. If readings are numbers of
photons, this is exact: the ones are binomial. Saturation and read noise change the mean and the
variance of the ones. They do not matter for the motion, and merged counts are corrected for them.
"""

import dataclasses
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.estimators.merge_near import average_fractions, diffuse
from jotlight.estimators.merge_readings import linear_counts
from jotlight.formats.capture import CountStack
from jotlight.sensing.alike_frames import require_one_exposure
from jotlight.sensing.frames import Frames
from jotlight.sensing.merged import Merged
from jotlight.sensing.multibit import reading_probability
from jotlight.sensing.photon_readings import Readings
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.response import Array
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

_RATES = 1025
"""Number of rates in the table of the response."""


class Response(NamedTuple):
    """The counts of readings at some rates, in photons per frame."""

    rates: Array
    mean: Array
    """Mean fraction of ones, which increases."""
    variance: Array
    """Variance of the fraction of ones of one reading."""
    slope: Array
    """Derivative of the mean."""


@dataclasses.dataclass(frozen=True)
class SpreadReadings:
    """Readings of several bits whose photons are spread over trials.

    Parameters
    ----------
    readings : Readings
        The readings, (T, H, W) or (T, H, W, C).
    stated : Sensor
        Their sensor.

    Examples
    --------
    >>> sensor = Sensor(frames=32, bit_depth=6, gain=64.0)
    >>> readings = sensor.expose(np.full((8, 8), 0.5), rng=0)
    >>> spread = SpreadReadings(readings, sensor)
    >>> spread.trials, spread.sensor
    (31, Sensor(frames=992, gain=64.0))
    """

    readings: Readings
    stated: Sensor

    def __post_init__(self) -> None:
        if self.stated.oversampling > 1:
            raise ValueError(
                "sensor: expected an oversampling of 1 for the motion in readings of several bits, "
                f"got {self.stated.oversampling}"
            )

    @cached_property
    def _bright(self) -> int:
        """A reading that few others exceed, in photons."""
        start = max(0, (len(self.readings) - _CENTRAL) // 2)
        middle = self.readings[start : start + _CENTRAL].to_array()
        return max(1, int(np.quantile(middle, _BRIGHT)))

    @cached_property
    def trials(self) -> int:
        """The number n of trials behind a reading: 2^m - 1, so that counts have m digits."""
        digits = (_TRIALS_PER_PHOTON * self._bright - 1).bit_length()
        return (1 << min(max(digits, _MIN_DIGITS), _MAX_DIGITS)) - 1

    @cached_property
    def sensor(self) -> Sensor:
        """The sensor of the counts, which has plain bits."""
        stated = self.stated
        return stated.replace(
            frames=stated.frames * self.trials,
            gain=stated.gain,
            bit_depth=1,
            read_noise=0.0,
            dark_counts=stated.dark_counts / self.trials,
        )

    @cached_property
    def counts(self) -> CountStack:
        """The number of ones of each reading, as a stack that computes them when they are read."""
        frames = Frames(self.readings.shape, self._read, np.uint16)
        provenance = self.readings.provenance or Provenance("readings", "readings")
        return CountStack(frames, provenance, self.trials)

    @cached_property
    def _ones(self) -> Array:
        """The mean number of ones of each reading that occurs, n (1 - (1 - 1/n)^r)."""
        readings = np.arange(self.stated.max_reading + 1)
        return np.asarray(-self.trials * np.expm1(readings * np.log1p(-1 / self.trials)))

    def _read(self, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Return the counts of some frames. Means are rounded at random, so they have no bias."""
        counts = np.empty((stop - start, *self.readings.shape[1:]), np.uint16)
        ones = self._ones.astype(np.float32)
        for index, frame in enumerate(range(start, stop)):
            noise = np.random.default_rng((_SEED, frame)).random(counts.shape[1:], np.float32)
            counts[index] = ones[self.readings.read(frame, frame + 1)[0]] + noise
        return counts

    @cached_property
    def response(self) -> Response:
        """The response up to rates at which nearly all readings are bright ones."""
        highest = min(self.stated.max_reading, 2 * self._bright + 16)
        reach = highest + 8 * (np.sqrt(highest) + self.stated.read_noise + 2)
        rates = np.linspace(0, np.sqrt(reach), _RATES) ** 2
        readings = np.arange(min(self.stated.max_reading, int(2 * reach)) + 1)
        probability = reading_probability(
            readings,
            rates[:, None],
            bit_depth=self.stated.bit_depth,
            read_noise=self.stated.read_noise,
        )
        ones = self._ones[: len(readings)]
        part = ones % 1
        mean = probability @ ones
        variance = probability @ (ones**2 + part * (1 - part)) - mean**2
        n = self.trials
        mean = np.maximum.accumulate(mean / n)
        return Response(rates, mean, variance / n**2, np.gradient(mean, rates))

    @property
    def noise_floor(self) -> float:
        """The ones of a trial without photons, because of read noise. They are dark counts."""
        return float(self.response.mean[0])

    def correct(self, merged: Merged) -> Merged:
        """Return merged counts whose likelihood near averages of neighbors is that of the readings.

        Parameters
        ----------
        merged : Merged
            Counts of :attr:`counts` along a motion.
        """
        if merged.ones.ndim == 2:
            return self._correct(merged)
        trials = np.broadcast_to(merged.trials, merged.shape)
        channels = [
            self._correct(dataclasses.replace(merged, ones=ones, trials=number, channel_axis=None))
            for ones, number in zip(
                np.moveaxis(merged.ones, -1, 0), np.moveaxis(trials, -1, 0), strict=True
            )
        ]
        return dataclasses.replace(
            merged,
            ones=np.stack([each.ones for each in channels], axis=-1),
            trials=np.stack([np.asarray(each.trials) for each in channels], axis=-1),
            dark_counts=channels[0].dark_counts,
            sensor=channels[0].sensor,
        )

    def _correct(self, merged: Merged) -> Merged:
        trials = np.broadcast_to(np.asarray(merged.trials, np.float64), merged.shape)
        known = trials > 0
        fraction = np.where(known, merged.ones / np.where(known, trials, 1), 0.0)
        table = self.response
        rates = np.interp(average_fractions(merged), table.mean, table.rates)
        mean, variance, slope = (np.interp(rates, table.rates, part) for part in table[1:])
        # With respect to the rate of a trial, which is the nth part of that of a reading.
        slope = self.trials * np.maximum(slope, 1e-9)
        weight = trials / self.trials * slope / np.maximum(variance, 1e-12)
        rate = np.maximum(rates / self.trials + self.noise_floor, 1e-9)
        ones, number = linear_counts(weight * (fraction - mean), weight * slope, 1.0, rate, rate)
        whole = diffuse(np.where(known, ones, 0.0), known)
        number = np.maximum(np.where(known, number, 0.0), whole)
        return dataclasses.replace(
            merged,
            ones=whole.astype(np.int32),
            trials=number,
            dark_counts=merged.dark_counts + self.noise_floor,
            sensor=self.sensor.replace(dark_counts=self.sensor.dark_counts + self.noise_floor),
        )


def spread_readings(data: object, sensor: object) -> SpreadReadings | None:
    """Return readings of several bits spread over trials, and None for other data.

    Parameters
    ----------
    data : Bits, CountStack, or Readings
        T frames.
    sensor : Sensor or None
        Their sensor. Default: the one of the data.

    Raises
    ------
    ValueError
        When the readings differ in gain or threshold, or lie behind a mosaic.
    """
    if not isinstance(data, Readings | CountStack):
        return None
    stated: Any = data.sensor if sensor is None else sensor
    if not isinstance(stated, Sensor) or stated.bit_depth == 1:
        return None
    require_one_exposure(stated)
    if stated.mosaic is not None:
        raise ValueError(
            "sensor: expected no mosaic for the motion in readings of several bits; "
            "jotlight.reconstruct makes one image of all frames"
        )
    if isinstance(data, CountStack):
        return SpreadReadings(data.readings(stated), stated)
    return SpreadReadings(Readings(data.frames, stated, data.provenance), stated)
