"""Kinds of jots, which show a scene differently: behind filters, or with different thresholds.

The filters of a mosaic and the thresholds of a map stand still, and the scene moves over them. So
the ones of each kind are merged by themselves along one motion, and joined afterward.
"""

from collections.abc import Sequence

import numpy as np

from jotlight.formats.capture import CountStack, jot_shape
from jotlight.motion.counts.burst import refuse_pixels
from jotlight.motion.merging.mosaic_colors import join_colors, sensors_of_colors
from jotlight.motion.merging.threshold_maps import join_thresholds, sensors_of_thresholds
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.data.alike_frames import require_alike_frames
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import frames_differ, without_mosaic
from jotlight.sensing.sensor import Sensor


def has_kinds(sensor: Sensor) -> bool:
    """Return whether the jots of a sensor are of several kinds.

    Examples
    --------
    >>> sensors = jl.Sensor(), jl.Sensor(mosaic="RGGB"), jl.Sensor(threshold=[[1, 2]])
    >>> tuple(has_kinds(sensor) for sensor in sensors)
    (False, True, True)
    """
    return sensor.mosaic is not None or np.ndim(sensor.threshold) == 2


def without_kinds(sensor: Sensor) -> Sensor:
    """Return a sensor that takes all jots for those of one kind: gray, with the lowest threshold.

    Examples
    --------
    >>> without_kinds(jl.Sensor(threshold=[[1, 2]])), without_kinds(jl.Sensor(mosaic="RGGB"))
    (Sensor(), Sensor())
    """
    gray = without_mosaic(sensor)
    if np.ndim(gray.threshold) < 2:
        return gray
    return gray.replace(threshold=int(np.min(gray.threshold)), gain=gray.gain)


def frames_of_kinds(data: object, sensor: object) -> tuple[Bits | CountStack, Sensor] | None:
    """Return bits or counts and their sensor if its jots are of several kinds, and None otherwise.

    Raises
    ------
    ValueError
        When other data have such a sensor, when counts are not those of jots, or when the readings
        of one kind differ.
    """
    stated = carried_sensor(data) if sensor is None and isinstance(data, Bits) else sensor
    if not isinstance(stated, Sensor) or not has_kinds(stated):
        return None
    kinds = "a map of thresholds" if stated.mosaic is None else "a mosaic"
    if not isinstance(data, Bits | CountStack):
        raise ValueError(
            f"data: expected bits or counts for a sensor with {kinds}, got {type(data).__name__}"
        )
    shape = jot_shape(data)
    if len(shape) != 3:
        each = "threshold" if stated.mosaic is None else "color"
        raise ValueError(
            f"data: expected gray frames (T, H, W) for a sensor with {kinds}, because its jots "
            f"have one {each} each, got shape {shape}"
        )
    if stated.mosaic is None and frames_differ(stated):
        raise ValueError(
            "sensor: expected one gain for a sensor with a map of thresholds, got a gain for each "
            "frame; motion, films, and the viewer take a map or exposures that repeat, but not "
            "both; jotlight.reconstruct makes one image of all frames"
        )
    # With a mosaic and a map of thresholds, there would be a kind for each pair of them.
    require_alike_frames(stated if stated.mosaic else without_kinds(stated))
    if isinstance(data, CountStack):
        refuse_pixels(stated)
        return data.with_trials_of(stated), stated
    check_fits(shape, stated)
    return data, stated


def sensors_of_kinds(sensor: Sensor, size: tuple[int, int]) -> list[Sensor]:
    """Return a sensor for each kind of jots. The other jots are dead.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    size : (int, int)
        H and W in jots.

    Raises
    ------
    ValueError
        When the kinds cannot be merged along a motion.
    """
    if sensor.mosaic is None:
        return sensors_of_thresholds(sensor)
    return sensors_of_colors(sensor, size)


def join_kinds(merged: Sequence[Merged], sensor: Sensor, threads: int | None = None) -> Merged:
    """Return the merged counts of all kinds as those of a color or gray image.

    Parameters
    ----------
    merged : sequence of Merged
        The counts of each kind.
    sensor : Sensor
        The sensor.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    if sensor.mosaic is None:
        return join_thresholds(merged, sensor, threads)
    return join_colors(merged, sensor)
