"""Counts whose number of trials is stated beside them."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import shown
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import frames_differ
from jotlight.sensing.sensor import Sensor

_MAX_TRIALS = 2**31
"""Sensors have fewer trials per pixel."""


def merge_counts(counts: npt.NDArray[np.int32], trials: Any, sensor: Sensor) -> Merged:
    """Return counts (H, W) of plain bits with their trials, which are 0 where jots are dead.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=4, mask=[[True, False]])
    >>> merge_counts(np.array([[0, 3]], np.int32), 4, sensor).trials.tolist()
    [[0.0, 4.0]]
    """
    valid = True if sensor.mask is None else ~sensor.mask
    return Merged(np.where(valid, counts, np.int32(0)), np.where(valid, trials, 0.0), sensor)


def with_trials(sensor: Sensor, trials: float | npt.NDArray[np.float64]) -> Sensor:
    """Return the sensor with as many frames as the trials of a pixel require.

    It serves counts of bits with read noise, or with different thresholds.

    Raises
    ------
    TypeError, ValueError
        When the trials are not the same number of whole frames in all pixels, or are 2**31 or
        more, or the frames differ.

    Examples
    --------
    >>> with_trials(jl.Sensor(frames=16, read_noise=0.3), 4)
    Sensor(frames=4, read_noise=0.3)
    """
    if frames_differ(sensor):
        raise ValueError(
            "trials: expected none, because the frames of the sensor differ in their gain or "
            "threshold; take frames of the bits instead: bits[a:b] carry the sensor of their frames"
        )
    distinct = np.unique(trials)
    per_frame = sensor.oversampling**2
    frames = int(distinct[0]) // per_frame
    is_whole = frames >= 1 and distinct[0] == frames * per_frame
    if distinct.size > 1 or not is_whole or distinct[0] >= _MAX_TRIALS:
        reason = f"read noise {sensor.read_noise:g}"
        if sensor.readings_differ:
            reason = "a threshold for each jot"
        numbers = "whole number" if per_frame == 1 else f"multiple of {per_frame}"
        raise ValueError(
            f"trials: expected one {numbers} below 2**31 for all pixels, because the sensor has "
            f"{reason}, got {shown(trials)}; state dead jots with its mask"
        )
    return sensor if frames == sensor.frames else sensor.replace(frames=frames)
