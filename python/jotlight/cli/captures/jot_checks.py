"""What the jots of a capture reveal without a calibration: periodic rates, and hot jots."""

import dataclasses

import numpy as np

from jotlight.array_types import Counts
from jotlight.calibration import find_periodic_rates
from jotlight.calibration.agreement import describe_conflict
from jotlight.calibration.hot_jots import (
    fewest_trials,
    hot_jots_of,
    hot_jots_unknown_reason,
)
from jotlight.calibration.jot_counts import JotCounts
from jotlight.cli.captures.captured import Captured
from jotlight.cli.terminal.console import caution, progress
from jotlight.errors import PeriodicRatesWarning, counted, warn
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import frames_within
from jotlight.sensing.sensor import Sensor

PERIODIC_RATES = "periodic rates"
"""Label of the remark about a mosaic."""

_MAX_BYTES = 1 << 26
"""Maximum number of bytes of bits that are read for remarks."""


def jot_remarks(counts: Counts, trials: int, sensor: Sensor) -> list[tuple[str, str]]:
    """Return remarks about the counts of single jots, each with a label.

    Hot jots can be searched: :func:`hot_jots_unknown_reason` is None.

    Parameters
    ----------
    counts : ndarray of int32, shape (H, W) or (H, W, C)
        Counts of single jots.
    trials : int
        Number of binary readings behind each count.
    sensor : Sensor
        The sensor, whose dead jots are not compared.
    """
    conflict = _dark_count_remarks(counts, trials, sensor)
    periodic = None if counts.ndim > 2 else find_periodic_rates(counts)
    if periodic is not None:
        # Under color filters, jots differ from their neighbors without being hot.
        return [*conflict, (PERIODIC_RATES, periodic.describe())]
    hot = hot_jots_of(counts, trials, sensor)
    if not hot.any():
        return conflict
    remark = (
        f"{counted(hot.sum(), 'jot')} of {hot.size} look hot, because they are much brighter than "
        "their neighbors; --find-hot-jots treats them as dead, and `jotlight calibrate` with a "
        "dark capture finds all hot jots"
    )
    return [*conflict, ("hot jots", remark)]


def caution_about_jots(captured: Captured, threads: int | None) -> None:
    """Print remarks about periodic rates and hot jots, from the first frames of a capture.

    A capture in which hot jots were searched has no remarks: that search refuses periodic rates.
    """
    sensor = captured.sensor
    if captured.hot_jots is not None or hot_jots_unknown_reason(captured.data, sensor):
        return
    for label, remark in jot_remarks(*_count_jots(captured, threads, _MAX_BYTES), sensor):
        if label == PERIODIC_RATES and captured.states_mosaic:
            continue  # the library says that the mosaic is left out
        if label == PERIODIC_RATES:
            warn(remark, PeriodicRatesWarning)  # the library has issued it, too, in most cases
        else:
            caution(label, remark)


def mask_hot_jots(captured: Captured, threads: int | None) -> Captured:
    """Return a capture whose sensor's mask also marks the hot jots that its scene reveals.

    Raises
    ------
    ValueError
        When pixels are counted, rather than jots, or the rates are periodic.
    """
    sensor = captured.sensor
    if (reason := hot_jots_unknown_reason(captured.data, sensor)) is not None:
        raise ValueError(f"find-hot-jots: {reason}")
    counts, trials = _count_jots(captured, threads)
    fewest = fewest_trials(counts, trials, threshold=sensor.threshold)
    if trials < fewest:
        caution(
            "find-hot-jots",
            f"{trials} frames are too few to find most hot jots; at the median brightness of this "
            f"scene it takes {fewest:,} or more",
        )
    periodic = None if counts.ndim > 2 else find_periodic_rates(counts)
    if periodic is not None:
        raise ValueError(
            "find-hot-jots: expected jots that see like their neighbors, but " + periodic.describe()
        )
    hot = hot_jots_of(counts, trials, sensor)
    mask = hot if sensor.mask is None else hot | sensor.mask
    return dataclasses.replace(
        captured,
        sensor=sensor.replace(mask=mask) if hot.any() else sensor,
        hot_jots=int(np.count_nonzero(hot)),
    )


def _dark_count_remarks(counts: Counts, trials: int, sensor: Sensor) -> list[tuple[str, str]]:
    """Return the remark that most hot jots of the sensor are not hot here, if it is true."""
    jots = JotCounts(counts, trials, sensor.threshold)
    conflict = describe_conflict(jots, sensor.dark_counts)
    return [] if conflict is None else [("dark counts", conflict)]


def _count_jots(
    captured: Captured, threads: int | None, max_bytes: int | None = None
) -> tuple[Counts, int]:
    """Return the counts of the jots and their trials."""
    data = captured.data
    if isinstance(data, Bits):
        if max_bytes is not None:
            data = data[: frames_within(data.packed, max_bytes)]
        with progress(1) as begin:
            return data.counts(1, threads=threads, progress=begin("counting jots")), len(data)
    return data.sum(), captured.sensor.trials
