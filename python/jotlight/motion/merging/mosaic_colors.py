"""Merged colors of the bits behind a mosaic."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.merge_readings import round_ones
from jotlight.motion.merging.jot_squares import squares_side
from jotlight.motion.merging.merged_pixels import mean_map
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor

FILTERS = "RGB"
"""The filters whose bits can be merged to a color image."""

_FEW = 0.5
"""A pixel has few bits of a color if it has less than this fraction of the usual number nearby."""


def is_mergeable(sensor: Sensor) -> bool:
    """Return whether the bits of a sensor can be merged along a motion.

    Behind a mosaic, they can if there are ideal filters for red, green, and blue, and no white
    balance.

    Examples
    --------
    >>> [is_mergeable(jl.Sensor(mosaic=mosaic)) for mosaic in (None, "RGGB", "RGBW")]
    [True, True, False]
    """
    mosaic = sensor.mosaic
    return mosaic is None or (
        mosaic.filters == FILTERS and mosaic.is_ideal and bool((mosaic.white_balance == 1).all())
    )


def check_mergeable(sensor: Sensor) -> None:
    """Raise ValueError if the bits of a sensor cannot be merged along a motion."""
    if is_mergeable(sensor):
        return
    mosaic = sensor.mosaic
    if mosaic.filters != FILTERS or not mosaic.is_ideal:
        raise ValueError(
            "sensor: expected ideal filters R, G, and B to merge bits behind a mosaic, got "
            f"{mosaic!r}; without motion, jotlight.reconstruct takes every mosaic"
        )
    raise ValueError(
        "sensor: expected a mosaic with the white balance 1 for merged counts, got "
        f"{np.asarray(mosaic.white_balance).tolist()}; multiply the estimate by it"
    )


def sensors_of_colors(sensor: Sensor, size: tuple[int, int]) -> list[Sensor]:
    """Return the gray sensors of the jots behind red, green, and blue filters.

    The other jots of each are dead.

    Parameters
    ----------
    sensor : Sensor
        The sensor, with a mosaic.
    size : (int, int)
        H and W in jots.

    Raises
    ------
    ValueError
        When bits behind the mosaic cannot be merged.

    Examples
    --------
    >>> red, green, blue = sensors_of_colors(jl.Sensor(mosaic="RGGB"), (4, 4))
    >>> red.mask[:2, :2].tolist()
    [[False, True], [True, True]]
    """
    check_mergeable(sensor)
    places = sensor.mosaic.of_jots(*size, sensor.oversampling)
    gray = without_mosaic(sensor)
    dead = np.zeros(size, bool) if sensor.mask is None else sensor.mask
    return [
        gray.replace(mask=dead | (places != index), gain=gray.gain) for index in range(len(FILTERS))
    ]


def join_colors(merged: Sequence[Merged], sensor: Sensor) -> Merged:
    """Return the merged counts of red, green, and blue as those of a color image.

    Where a slow motion has shown a pixel through few filters, it lacks the bits of a color. Then
    those of the same color nearby count, too. Efficiency and dark counts are the means over the
    colors. A pixel is flagged if it is for two colors.

    Parameters
    ----------
    merged : sequence of Merged
        The counts of each color.
    sensor : Sensor
        The sensor, with a mosaic.
    """
    shape, mean = merged[0].shape, partial(mean_map, merged)
    side = squares_side(sensor) // sensor.oversampling
    counts = [
        _with_neighbors(each.ones, np.broadcast_to(each.trials, shape), side) for each in merged
    ]
    return Merged(
        np.stack([ones for ones, _ in counts], axis=-1),
        np.stack([trials for _, trials in counts], axis=-1),
        sensor.replace(mosaic=None, mask=None, gain=sensor.gain),
        dark_counts=mean("dark_counts"),
        efficiency=mean("efficiency"),
        acceptance=mean("acceptance").astype(np.float32),
        posterior_error=mean("posterior_error").astype(np.float32),
        flags=mean("flags") > 1 / 2,
        channel_axis=-1,
    )


def _with_neighbors(
    ones: npt.NDArray[np.int32], trials: Array, side: int
) -> tuple[npt.NDArray[np.int32], Array]:
    """Return the counts of a color, with those nearby where a pixel has few.

    The counts nearby are linearly interpolated, as over a period of the mosaic.
    """
    from scipy.ndimage import convolve1d

    weights = np.concatenate([np.arange(1, side), np.arange(side, 0, -1)]) / side**2

    def nearby(values: npt.NDArray[Any]) -> Array:
        rows = convolve1d(values.astype(np.float64), weights, axis=0, mode="mirror")
        return np.asarray(convolve1d(rows, weights, axis=1, mode="mirror"))

    usual = nearby(trials)
    share = np.clip(1 - trials / np.maximum(_FEW * usual, 1e-9), 0, 1)
    return round_ones(
        (1 - share) * ones + share * nearby(ones), (1 - share) * trials + share * usual
    )
