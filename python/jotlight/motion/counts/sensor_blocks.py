"""The blocks of a burst that a sensor recorded: which jots and frames are counted in them."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.checks import check_threads
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import Burst
from jotlight.motion.counts.dark_frames import find_dark
from jotlight.motion.counts.jots import Jots
from jotlight.sensing.parameters.response import detection_probability
from jotlight.sensing.sensor import Sensor

_MIN_HOT_RATIO = 5.0
"""Jots with dark counts above this multiple of the median are hot, if they exceed the light, too.

They stand still, so they would pull the motion toward 0.
"""


def as_blocks(
    burst: Burst,
    edges: npt.NDArray[np.intp],
    sensor: Sensor,
    threads: int | None,
    *,
    with_hot_jots: bool = False,
) -> Blocks:
    """Return the blocks of a burst that a sensor recorded.

    Parameters
    ----------
    burst, edges, threads
        As for :class:`jotlight.motion.counts.blocks.Blocks`.
    sensor : Sensor
        The sensor. Its dead jots are not counted, nor are frames without light.
    with_hot_jots : bool
        Whether hot jots are counted.
    """
    check_threads(threads)
    valid = valid_jots(sensor, with_hot_jots=with_hot_jots)
    jots = Jots.of_sensor(sensor, burst.size, valid)
    dark = find_dark(burst.ones(valid, threads), _dark_ones(burst, sensor, valid))
    burst = dataclasses.replace(burst, dark=dark if dark.any() else None)
    return Blocks(burst, edges, valid, threads, jots=jots)


def _dark_ones(burst: Burst, sensor: Sensor, valid: npt.NDArray[np.uint8] | None) -> float:
    """Return the number of ones that a frame has without light, in the box of a burst."""
    if not np.any(sensor.dark_counts):
        return 0.0
    probability = detection_probability(burst.threshold, sensor.dark_counts)
    rows, columns = burst.box
    jots = np.broadcast_to(probability, burst.size)[:rows, :columns]
    if valid is not None:
        jots = jots * np.unpackbits(valid, axis=1, count=columns)[:rows]
    return burst.trials * float(jots.sum())


def valid_jots(sensor: Sensor, *, with_hot_jots: bool = False) -> npt.NDArray[np.uint8] | None:
    """Return the packed mask of the jots that are neither dead nor hot, or None if all are good."""
    excluded = sensor.mask if with_hot_jots else excluded_jots(sensor)
    if excluded is None or not excluded.any():
        return None
    return np.packbits(~excluded, axis=1)


def excluded_jots(sensor: Sensor) -> npt.NDArray[np.bool_] | None:
    """Return the jots that are dead or hot, or None if there are none."""
    dead, hot = sensor.mask, hot_jots(sensor)
    return dead if hot is None else hot if dead is None else dead | hot


def hot_jots(sensor: Sensor) -> npt.NDArray[np.bool_] | None:
    """Return the hot jots, or None if there are none."""
    dark = sensor.dark_counts
    if not isinstance(dark, np.ndarray):
        return None
    light = sensor.light_per_intensity * sensor.max_intensity
    hot = (dark > _MIN_HOT_RATIO * np.median(dark)) & (dark > 0.01 * light)
    return hot if hot.any() else None
