"""Merged counts of jots with different thresholds."""

import dataclasses
from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.merge_readings import linear_counts
from jotlight.estimators.readings.merge_near import Merging
from jotlight.estimators.readings.neighbors import average_fractions, toward_own
from jotlight.estimators.readings.reference_sensors import light_share, reference_sensor
from jotlight.estimators.readings.whole_counts import whole_counts
from jotlight.formats.capture import CountStack
from jotlight.motion.merging.merged_pixels import mean_map
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    intensity_at_probability,
)
from jotlight.sensing.sensor import Sensor

_MIN_RATE = 1e-6
"""Smallest rate of a jot near which ones are counted. In darkness, their slope is 0."""

_MIN_PROBABILITY = 1e-12
"""Smallest probability of a one or a zero by which information is divided."""


def sensors_of_thresholds(sensor: Sensor) -> list[Sensor]:
    """Return the sensors of the jots with each threshold, in ascending order.

    The other jots of each are dead.

    Examples
    --------
    >>> low, high = sensors_of_thresholds(jl.Sensor(threshold=[[1, 3], [3, 1]]))
    >>> high.threshold, high.mask.tolist()
    (3, [[True, False], [False, True]])
    """
    thresholds = np.asarray(sensor.threshold)
    dead = np.zeros(thresholds.shape, bool) if sensor.mask is None else sensor.mask
    return [
        sensor.replace(threshold=int(each), mask=dead | (thresholds != each), gain=sensor.gain)
        for each in np.unique(thresholds)
    ]


def join_thresholds(merged: Sequence[Merged], sensor: Sensor, threads: int | None = None) -> Merged:
    """Return the merged counts of jots with different thresholds as equivalent counts.

    The likelihood of a pixel is the product of those of all thresholds. Equivalent counts have the
    same derivative and the same information near averages of neighbors, or near the most likely
    intensity of the pixel if its signal-to-noise ratio is high (decision 53). Efficiency and dark
    counts are the means over the thresholds. A pixel is flagged if it is for more than half of
    those that have seen it.

    Parameters
    ----------
    merged : sequence of Merged
        The counts of each threshold.
    sensor : Sensor
        The sensor, with a map of thresholds.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    mean = partial(mean_map, merged)
    reference = reference_sensor(sensor)
    near = _average(merged)
    gradient, information = _likelihood(merged, near)
    own = np.maximum(near + gradient / np.maximum(information, _MIN_PROBABILITY), 0)
    light = toward_own(near, own, information)
    gradient, information = _likelihood(merged, light)
    efficiency, dark_counts = mean("efficiency"), mean("dark_counts")
    slope = efficiency * reference.light_per_intensity
    rate = np.maximum(slope * light + dark_counts, _MIN_RATE)
    threshold = int(reference.threshold)
    ones, trials = linear_counts(gradient, information, slope, rate, rate, threshold)
    ones, trials = (np.where(information > 0, part, 0.0) for part in (ones, trials))
    return Merged(
        *whole_counts(ones, trials, threads=threads),
        reference,
        dark_counts=dark_counts,
        efficiency=efficiency,
        acceptance=mean("acceptance").astype(np.float32),
        posterior_error=mean("posterior_error").astype(np.float32),
        flags=_flags(merged),
        light_share=light_share(sensor, reference),
    )


def count_still(
    data: Bits | CountStack, sensor: Sensor, joined: Merged, threads: int | None
) -> Merged:
    """Return equivalent counts of a scene that stands still, near averages of neighbors.

    Each jot has then seen its place with one threshold alone, so some pixels say much and their
    neighbors little. :class:`jotlight.estimators.readings.merge_near.Merging` smooths such counts.

    Parameters
    ----------
    data : Bits or CountStack
        The frames.
    sensor : Sensor
        Their sensor, with a map of thresholds.
    joined : Merged
        What :func:`join_thresholds` returns for them. Its flags and errors are kept.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    counts = data.sum() if isinstance(data, CountStack) else data
    near = Merging(joint_likelihood(counts, sensor, threads)).near_neighbors()
    return dataclasses.replace(
        near,
        acceptance=joined.acceptance,
        posterior_error=joined.posterior_error,
        flags=joined.flags,
    )


def _flags(merged: Sequence[Merged]) -> npt.NDArray[np.bool_]:
    """Return whether most thresholds that have seen a pixel flag it, or none has seen it."""
    has_seen = [np.broadcast_to(np.asarray(each.trials) > 0, each.shape) for each in merged]
    flagged = [np.asarray(each.flags) & seen for each, seen in zip(merged, has_seen, strict=True)]
    number = np.sum(has_seen, axis=0)
    return np.asarray((2 * np.sum(flagged, axis=0) > number) | (number == 0))


def _average(merged: Sequence[Merged]) -> Array:
    """Return the intensity that the ones around each pixel state, (H, W).

    It is the mean over the thresholds, weighted by their information.
    """
    total = weights = np.zeros(merged[0].shape)
    for each in merged:
        trials = np.broadcast_to(np.asarray(each.trials, np.float64), each.shape)
        fraction = average_fractions(each.ones, trials)
        intensity = np.maximum(
            intensity_at_probability(
                each.sensor.threshold, fraction, 1 - fraction, _slope(each), each.dark_counts
            ),
            0,
        )
        weight = _likelihood([each], intensity)[1] + _MIN_PROBABILITY
        total, weights = total + weight * intensity, weights + weight
    return np.asarray(total / weights)


def _likelihood(merged: Sequence[Merged], intensity: Array) -> tuple[Array, Array]:
    """Return the derivative of the log-likelihood by the intensity, and the information, (H, W)."""
    gradient = information = np.zeros(merged[0].shape)
    for each in merged:
        slope = _slope(each)
        rate = np.maximum(slope * intensity + each.dark_counts, _MIN_RATE)
        p = detection_probability(each.sensor.threshold, rate)
        change = slope * detection_density(each.sensor.threshold, rate)
        weight = change / np.maximum(p * (1 - p), _MIN_PROBABILITY)
        gradient = gradient + weight * (each.ones - each.trials * p)
        information = information + weight * change * each.trials
    return gradient, information


def _slope(merged: Merged) -> Array | float:
    """Return the rate of a jot at the intensity 1, without dark counts."""
    return merged.efficiency * merged.sensor.light_per_intensity
