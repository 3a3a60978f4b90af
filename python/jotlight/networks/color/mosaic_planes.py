"""The planes of a mosaic: gray images of the pixels of each filter."""

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image, Pattern
from jotlight.errors import hide_warnings
from jotlight.estimators.demosaicing import brightest_mean
from jotlight.estimators.inpaint import NO_VALID_BIT, warn_about_dead_pixels
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.likelihood.reference import reading_information
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor

I = TypeVar("I")  # noqa: E741

MAX_POSITIONS = 4
"""Maximum number of pixels of a period whose positions are planes of their own. In longer periods,
the pixels of one position are too far apart, so the pixels of each filter are one plane."""

_MIN_INTENSITY = 1e-3
"""Smallest intensity at which the information of a pixel is computed."""


def estimate_values(
    counted: PixelCounts,
    mosaic: Mosaic,
    estimate: Callable[[Any, Sensor], tuple[Image, I]],
) -> tuple[Image, npt.NDArray[np.float64], list[I]]:
    """Return the estimated intensity behind each pixel's filter, divided by its sensitivity.

    Parameters
    ----------
    counted : PixelCounts
        The counts of the pixels, (H, W). Their sensor has no mosaic.
    mosaic : Mosaic
        The filters.
    estimate : callable
        ``estimate(planes, sensor)`` returns the estimates of gray planes, (N, h, w), and
        information about them.

    Returns
    -------
    ndarray of float32, shape (H, W)
        The intensities.
    ndarray of float64, shape (H, W)
        How much each of them counts: :func:`value_weights`.
    list
        How the planes were estimated.

    Raises
    ------
    ValueError
        When no pixel of a plane has a valid bit.
    """
    places = mosaic.full(*counted.counts.shape)
    by_filter = mosaic.pattern.size > MAX_POSITIONS
    if unseen := find_unseen(counted, mosaic):
        raise ValueError(
            "trials: expected at least one pixel with a valid bit behind each filter of the "
            f"mosaic, got none behind {unseen}; the sensor's mask marks all of its jots as dead, "
            "or all of its trials are 0"
        )
    if by_filter and (dead := counted.dead_pixels) is not None:
        warn_about_dead_pixels(dead[None])
    values = np.zeros(counted.counts.shape, np.float32)
    infos = []
    for index, planes in _planes(places, mosaic):
        own = _plane_sensor(counted.sensor, float(mosaic.sensitivity[index]))
        # In planes by filter, the pixels of other filters are not dead.
        with hide_warnings(NO_VALID_BIT) if by_filter else contextlib.nullcontext():
            estimates, info = estimate(_plane_data(counted, own, planes), own)
        infos.append(info)
        for plane, image in zip(planes, estimates, strict=True):
            plane.write(values, image)
    return values, value_weights(values, counted, mosaic), infos


def value_weights(values: Image, counted: PixelCounts, mosaic: Mosaic) -> npt.NDArray[np.float64]:
    """Return the Fisher information of each pixel about the intensity behind its filter, (H, W).

    Intensities are those of white. The information is that at the brightest mean around the pixel
    behind any filter. So filters that pass much light do not count where their bits are saturated,
    whose estimates are too dark.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import count_pixels
    >>> sensor = jl.Sensor(frames=4, gain=32.0)
    >>> counted = count_pixels(np.full((2, 2), 4, np.int32), sensor, None)
    >>> weights = value_weights(np.full((2, 2), 0.5), counted, Mosaic("RGBW"))
    >>> weights.round(6).tolist()  # 4 photons, and 12 behind the clear filter
    [[4.776284, 4.776284], [4.776284, 0.014156]]
    """
    places = mosaic.full(*values.shape)
    bright = brightest_mean(values, places)
    trials = np.broadcast_to(np.asarray(counted.trials, np.float64), values.shape)
    weights = np.zeros(values.shape)
    for index in np.unique(places):
        own = places == index
        plane = _plane_sensor(counted.sensor, float(mosaic.sensitivity[index]))
        light = plane.light_per_intensity * np.maximum(bright[own], _MIN_INTENSITY)
        weights[own] = (
            trials[own] * plane.light_per_intensity**2 * reading_information(plane, light)
        )
    return weights


@dataclasses.dataclass(frozen=True)
class _Plane:
    """The pixels of a filter: every n-th row and column, or those where `own` is True."""

    rows: slice
    columns: slice
    own: npt.NDArray[np.bool_] | None = None

    def take(self, value: Any) -> Any:
        """Return the values of the pixels, if they have several."""
        return value[self.rows, self.columns] if isinstance(value, np.ndarray) else value

    def write(self, values: Image, image: Image) -> None:
        """Write the pixels of the image."""
        if self.own is None:
            values[self.rows, self.columns] = image
        else:
            values[self.own] = image[self.own]


def _planes(places: Pattern, mosaic: Mosaic) -> Iterator[tuple[int, list[_Plane]]]:
    """Yield the place of each filter with its planes, which have the same size in each list."""
    height, width = mosaic.pattern.shape
    if mosaic.pattern.size > MAX_POSITIONS:
        for index in np.unique(places).tolist():
            yield index, [_Plane(slice(None), slice(None), places == index)]
        return
    planes: dict[tuple[int, tuple[int, ...]], list[_Plane]] = {}
    for (row, column), index in np.ndenumerate(mosaic.pattern):
        plane = _Plane(slice(row, None, height), slice(column, None, width))
        shape = plane.take(places).shape
        if 0 not in shape:
            planes.setdefault((int(index), shape), []).append(plane)
    for (index, _), same in planes.items():
        yield index, same


def find_unseen(counted: PixelCounts, mosaic: Mosaic) -> str | None:
    """Return which plane has no pixel with a valid bit, or None if there is no such plane.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import count_pixels
    >>> sensor = jl.Sensor(frames=4, mask=np.array([[False, False], [False, True]]))
    >>> find_unseen(count_pixels(np.zeros((2, 2), np.int32), sensor, None), Mosaic("RGGB"))
    'B, whose first pixel is (1, 1)'
    """
    dead = counted.dead_pixels
    if dead is None:
        return None
    for index, planes in _planes(mosaic.full(*counted.counts.shape), mosaic):
        for plane in planes:
            own = plane.take(dead) if plane.own is None else dead[plane.own]
            if own.all():
                first = plane.rows.start, plane.columns.start
                where = f", whose first pixel is {first}" if plane.own is None else ""
                return f"{mosaic.filters[index]}{where}"
    return None


def _plane_sensor(sensor: Sensor, sensitivity: float) -> Sensor:
    """Return the sensor of the pixels of a filter, which sees white light of intensity 1 as 1."""
    return sensor.without_maps().replace(gain=sensor.gain * sensitivity)


def plane_sensors(sensor: Sensor) -> list[Sensor]:
    """Return the sensors of the planes of each filter of a mosaic; a gray sensor is its own plane.

    Examples
    --------
    >>> plane_sensors(jl.Sensor(frames=4, mosaic="RGBW"))[-1]
    Sensor(frames=4, gain=12.0)
    """
    if sensor.mosaic is None:
        return [sensor]
    gray = without_mosaic(sensor)
    return [_plane_sensor(gray, float(each)) for each in sensor.mosaic.sensitivity]


def _plane_data(counted: PixelCounts, own: Sensor, planes: list[_Plane]) -> Any:
    """Return the counts of planes, (N, h, w), or merged counts if their pixels differ."""
    # Merged counts may have other numbers than their sensor.
    sensor = counted.sensor
    are_usual = not sensor.maps() and all(
        np.array_equal(getattr(counted, name), getattr(sensor, name))
        for name in ("trials", "efficiency", "dark_counts")
    )
    if planes[0].own is None and are_usual:
        return np.stack([plane.take(counted.counts) for plane in planes])
    data = []
    for plane in planes:
        ones, trials = plane.take(counted.counts), plane.take(counted.trials)
        if plane.own is not None:
            ones, trials = np.where(plane.own, ones, 0), np.where(plane.own, trials, 0.0)
        dark, efficiency = plane.take(counted.dark_counts), plane.take(counted.efficiency)
        whole = ones.astype(np.int32)
        data.append(Merged(whole, trials, own, dark_counts=dark, efficiency=efficiency))
    return data
