"""The choice of gains and thresholds for a range of light."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import to_array
from jotlight.estimators.planning.bracket_choice import FrameDivision
from jotlight.notebook import card, table_of
from jotlight.sensing.bits.values import numbers_from_zero
from jotlight.sensing.likelihood.reference import (
    reading_information,
    reference_jot,
    sensor_of_median_jot,
)
from jotlight.sensing.parameters.reading_groups import refuse_different_readings
from jotlight.sensing.sensor import Sensor, require_sensor

_LEVELS = 49
"""Number of levels of light at which the SNR is compared."""

_GRID = 200
"""Number of levels per factor of ten on which a range of light is searched."""


@dataclasses.dataclass(frozen=True, eq=False)
class BracketPlan:
    """The gains and thresholds of frames for a range of light, and the SNR that they allow.

    Light is in photons per jot and frame of the longest exposure, and SNR is in dB.

    Attributes
    ----------
    sensor : Sensor
        The sensor with these gains and thresholds, from the longest exposure to the shortest.
    exposures : ndarray of float64
        The fractions of the longest exposure, one for each setting, (G,).
    thresholds : ndarray of int64
        The thresholds, one for each setting, (G,).
    frames : ndarray of int64
        The number of frames of each setting, (G,).
    light : ndarray of float64
        The levels of light in ascending order, (N,).
    snr : ndarray of float64
        The light over the root mean square error of `jotlight.mle` in dB, (N,).
    snr_bound : ndarray of float64
        The light over the Cramér-Rao bound of a pixel in dB, (N,). Few frames do not reach it.
    single_snr : ndarray of float64
        `snr` of the best single setting, (N,).
    """

    sensor: Sensor
    exposures: Array
    thresholds: npt.NDArray[np.int64]
    frames: npt.NDArray[np.int64]
    light: Array
    snr: Array
    snr_bound: Array
    single_snr: Array

    @property
    def min_snr(self) -> float:
        """The lowest SNR in the range, in dB."""
        return float(self.snr.min())

    def _rows(self) -> list[tuple[str, str, str]]:
        settings = zip(self.frames, self.exposures, self.thresholds, strict=True)
        return [(f"{n}", f"{exposure:.4g}", f"{q}") for n, exposure, q in settings]

    def _repr_html_(self) -> str:
        facts = {
            "light": f"{self.light[0]:.3g} to {self.light[-1]:.3g} photons per jot and frame",
            "lowest SNR": f"{self.min_snr:.1f} dB",
            "with one setting": f"{self.single_snr.min():.1f} dB",
        }
        return card("BracketPlan", facts) + table_of(
            ["frames", "exposure", "threshold"], self._rows()
        )

    def __repr__(self) -> str:
        settings = ", ".join(f"{n} x {exposure}, q={q}" for n, exposure, q in self._rows())
        return (
            f"<BracketPlan: {settings}; SNR of at least {self.min_snr:.1f} dB from "
            f"{self.light[0]:.3g} to {self.light[-1]:.3g} photons>"
        )


def plan_brackets(
    sensor: Sensor,
    light: tuple[float, float],
    *,
    exposures: Sequence[float] | None = None,
    thresholds: Sequence[int] = (1,),
) -> BracketPlan:
    """Return exposures and thresholds of frames with a high SNR throughout a range of light.

    Parameters
    ----------
    sensor : Sensor
        A sensor with T frames of the longest exposure: one gain and one threshold. Maps are
        replaced by the median of the live jots.
    light : (float, float)
        The minimum and the maximum of the scene, in photons per jot and frame of the longest
        exposure, above 0. If the efficiency is a map, they are photons that the median jot detects,
        as for `jotlight.plan`.
    exposures : sequence of float, optional
        The possible exposures as fractions of the longest one, in (0, 1]. Default: 1, 1/2, 1/4, …,
        down to one at which the brightest light is not saturated.
    thresholds : sequence of int
        The possible thresholds, 1 to 65535.

    Returns
    -------
    BracketPlan
        Its sensor simulates the capture, or describes it.

    Raises
    ------
    TypeError, ValueError
        When an argument is out of range, or the readings of the sensor already differ.

    Notes
    -----
    The quality at a level is the SNR of `jotlight.mle`, or its Cramér-Rao bound where that is
    lower. The plan aims at a high value of its minimum in the range. Linear programs divide the
    frames by the Fisher information, and by how much the readings at two levels of light differ.
    Single frames then move to other settings while this raises the minimum.

    The bound alone would promise too much: a few nearly saturated frames have much information, but
    only in their few zeros. The SNR alone would praise saturated pixels, whose estimates are
    clipped near their light.

    The SNR is that of a statistic close to the estimate
    (:mod:`jotlight.estimators.planning.planned_estimates`). It is up to 1 dB above that of
    `jotlight.mle` for 48 frames or more. For fewer frames, it is up to 2 dB above, because single
    frames of a setting decide. S of the plan's sensor is that of `sensor` if it covers the range.
    Otherwise it is the larger one of the maximum of the range, and the intensity half a reading
    below saturation.

    Examples
    --------
    >>> found = jl.plan_brackets(jl.Sensor(frames=48), (0.05, 100.0))
    >>> int(found.frames.sum()), bool(found.min_snr > found.single_snr.min() + 10)
    (48, True)
    >>> found.sensor.readings_differ
    True
    """
    require_sensor(sensor, may_differ=True)
    refuse_different_readings(
        sensor, "state one of each; jotlight.plan_brackets finds exposures that differ"
    )
    levels, median = _checked_light(light), sensor_of_median_jot(sensor)
    # A bit is most informative at 1.6 detections, and several bits are just below saturation.
    best_rate = max(1.6, 0.7 * sensor.max_reading)
    brightest = levels[-1] * reference_jot(median).efficiency / best_rate
    fractions = _checked_exposures(exposures, brightest)
    if np.ndim(thresholds) != 1 or not len(thresholds):
        raise ValueError(
            f"thresholds: expected a list with at least one, such as [1, 3], got {thresholds!r}"
        )
    qs = [sensor.replace(threshold=q).threshold for q in thresholds]
    settings = [(float(fraction), q) for fraction in fractions for q in sorted(set(qs))]
    choice = FrameDivision(median, settings, levels)
    numbers, single = choice.best(sensor.frames), choice.best_single(sensor.frames)
    used = np.flatnonzero(numbers)
    own, frames = [settings[i] for i in used], numbers[used]
    gain = np.repeat([fraction for fraction, _ in own], frames) * sensor.gain / sensor.frames
    return BracketPlan(
        sensor=sensor.replace(
            gain=gain,
            threshold=np.repeat([q for _, q in own], frames),
            max_intensity=choice.max_light(numbers) / median.light_per_intensity,
        ),
        exposures=np.array([fraction for fraction, _ in own]),
        thresholds=np.array([q for _, q in own], np.int64),
        frames=frames,
        light=levels,
        snr=choice.snr(numbers),
        snr_bound=choice.bound(numbers),
        single_snr=choice.snr(single),
    )


def snr_bound(sensor: Sensor, intensity: npt.ArrayLike) -> Array:
    """Return the intensity over the Cramér-Rao bound in dB, for readings that may differ.

    Parameters
    ----------
    sensor : Sensor
        Any sensor. Maps of efficiency and dark counts are replaced by the median of the live jots.
    intensity : array_like of float
        Intensities above 0.

    Examples
    --------
    >>> snr_bound(jl.Sensor(frames=48), [0.5, 2.0]).round(1)
    array([12.7, 14.8])
    """
    values = numbers_from_zero("intensity", intensity)
    total = np.zeros(values.shape)
    for group in sensor.groups():
        own, light = group.sensor, group.sensor.light_per_intensity
        jots: float = sensor.oversampling**2
        if np.ndim(sensor.threshold) == 2:  # the pixels are mixed in equal shares
            jots *= float(np.mean(sensor.threshold == own.threshold))
        information = reading_information(own, light * values)
        total += own.frames * jots * (light * values) ** 2 * information
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(total))


def intensity_range(sensor: Sensor, snr: float) -> tuple[float, float]:
    """Return the widest range of intensities throughout which the SNR bound reaches `snr` dB.

    Parameters
    ----------
    sensor : Sensor
        Any sensor, as for :func:`snr_bound`.
    snr : float
        The SNR in dB.

    Returns
    -------
    (float, float)
        The minimum and the maximum, in a range without a gap.

    Raises
    ------
    ValueError
        When no intensity reaches this SNR.

    Examples
    --------
    >>> low, high = intensity_range(jl.Sensor(frames=48), 9.0)
    >>> round(float(20 * np.log10(high / low)), 1)  # dB
    28.9
    """
    groups = [group.sensor for group in sensor.groups()]
    lights = [group.light_per_intensity for group in groups]
    rates = [group.light_per_intensity * reference_jot(group).efficiency for group in groups]
    highest = float(np.max(sensor.threshold) - 1 + sensor.max_reading) * 1e4 / min(rates)
    # With more frames, the SNR is reached with less light.
    lowest = min(1e-6, 0.01 / sensor.trials) / max(lights)
    number = int(np.ceil(np.log10(highest / lowest) * _GRID))
    grid = np.geomspace(lowest, highest, number)
    bounds = snr_bound(sensor, grid)
    reached = bounds >= snr
    edges = np.flatnonzero(np.diff(np.concatenate([[0], reached.astype(np.int8), [0]])))
    if not len(edges):
        raise ValueError(
            f"snr: expected at most {bounds.max():.1f} dB, which the sensor reaches, got {snr}"
        )
    starts, stops = edges[::2], edges[1::2] - 1
    widest = int(np.argmax(stops - starts))

    def cross(inside: int, outside: int) -> float:
        """Return the intensity between two levels at which the bound is `snr`."""
        if not 0 <= outside < number:
            return float(grid[inside])
        part = (snr - bounds[inside]) / (bounds[outside] - bounds[inside])
        return float(grid[inside] * (grid[outside] / grid[inside]) ** part)

    first, last = int(starts[widest]), int(stops[widest])
    return cross(first, first - 1), cross(last, last + 1)


def best_threshold(light: float, *, max_threshold: int = 256) -> int:
    """Return the threshold at which a bit has the highest information about the light.

    With it, about half of the bits are ones in bright light, and fewer in dim light.

    Parameters
    ----------
    light : float
        The expected detections per jot and frame, above 0.
    max_threshold : int
        The highest threshold that the sensor has, 1 to 65535.

    Examples
    --------
    >>> best_threshold(0.3), best_threshold(10.0)
    (1, 11)
    """
    sensor = Sensor()
    if not 0 < light <= 1e5:
        raise ValueError(f"light: expected photons per jot and frame, above 0 to 1e5, got {light}")
    highest = sensor.replace(threshold=max_threshold).threshold
    # Far from the light, in standard deviations, a bit has next to no information.
    reach = 10 * np.sqrt(light) + 10
    first = int(np.clip(light - reach, 1, highest))
    last = int(np.clip(light + reach, 1, highest))
    information = [
        float(reading_information(sensor.replace(threshold=threshold), light))
        for threshold in range(first, last + 1)
    ]
    return first + int(np.argmax(information))


def _checked_light(light: tuple[float, float]) -> Array:
    levels = to_array("light", light)
    if levels.dtype.kind not in "iuf" or levels.shape != (2,):
        raise TypeError(
            "light: expected the minimum and the maximum in photons per jot and frame, such as "
            f"(0.05, 100), got {light!r}"
        )
    low, high = levels.astype(np.float64)
    if not 0 < low < high <= 1e9:
        raise ValueError(
            f"light: expected a minimum below the maximum, above 0 and up to 1e9, got {light!r}"
        )
    return np.geomspace(low, high, _LEVELS)


def _checked_exposures(exposures: Sequence[float] | None, brightest: float) -> Array:
    """Return fractions of the longest exposure. `brightest` is in units of the best light."""
    if exposures is None:
        number = max(0, int(np.ceil(np.log2(brightest)))) if brightest > 0 else 0
        return np.asarray(0.5 ** np.arange(number + 2))
    values = np.asarray(exposures)
    is_list = values.dtype.kind in "iuf" and values.ndim == 1 and values.size > 0
    if not is_list or not ((values > 0) & (values <= 1)).all():
        raise ValueError(
            "exposures: expected fractions of the longest exposure, above 0 and up to 1, such as "
            f"(1, 1/8, 1/64), got {exposures!r}"
        )
    return np.unique(values.astype(np.float64))[::-1]
