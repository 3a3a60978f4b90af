"""Color estimates of sensors with a mosaic: planes of the filters, and then demosaicing."""

import dataclasses
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import JotlightWarning
from jotlight.estimators.demosaicing import TITLES, choose_demosaicing, demosaic
from jotlight.estimators.inpaint import warn_about_dead_pixels
from jotlight.estimators.merge_readings import merge_images
from jotlight.evaluation.info import Info, join_infos
from jotlight.layout import Layout
from jotlight.sensing.merged import Merged
from jotlight.sensing.mosaic import Mosaic, Pattern
from jotlight.sensing.output_images import OutputImages
from jotlight.sensing.pixel_counts import (
    Data,
    GrayData,
    GrayImages,
    PixelCounts,
    count_pixels,
    gray_images,
    prepare_data,
)
from jotlight.sensing.sensor import Sensor

Image = npt.NDArray[np.float32]

MAX_POSITIONS = 4
"""Maximum number of pixels of a period whose positions are planes of their own. In longer periods,
the pixels of one position are too far apart, so the pixels of each filter are one plane."""


EstimatePlanes = Callable[[Any, Sensor], tuple[Image, Info]]
"""A function from the data of gray planes and their sensor to their estimates (N, h, w), and how
these were made."""


def reconstruct_mosaic(
    data: Data,
    sensor: Sensor,
    estimate: EstimatePlanes,
    *,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    demosaicing: str | None = None,
    out: Image | None = None,
    threads: int | None = None,
) -> tuple[Image, Info]:
    """Return the colors of the image of a mosaic, or of each image of a stack.

    Parameters
    ----------
    data : Bits, Readings, Merged, list of them, or array_like of int
        The data, as of :func:`jotlight.reconstruct`. The pixels are those of the mosaic.
    sensor : Sensor
        Their sensor, with a mosaic.
    estimate : callable
        ``estimate(planes, sensor)`` returns the estimates of gray planes, (N, h, w), and how they
        were made.
    trials, channel_axis, out, threads
        As of :func:`jotlight.reconstruct`.
    demosaicing : {"menon", "differences"}, optional
        The method of demosaicing. Default: as of :func:`jotlight.estimators.demosaicing.demosaic`.

    Returns
    -------
    ndarray of float32, shape (..., H, W, 3)
        Red, green, and blue in [0, S].
    Info
        How the planes were made, with the time of everything.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together.

    Examples
    --------
    >>> from functools import partial
    >>> from jotlight.evaluation.reconstruct import reconstruct
    >>> sensor = Sensor(frames=10_000, mosaic="RGBW", max_intensity=2.0)
    >>> bits = sensor.expose(np.full((8, 8, 3), [0.3, 0.2, 0.1]), rng=0)
    >>> estimate = partial(reconstruct, method="mle", return_info=True)
    >>> colors, info = reconstruct_mosaic(bits, sensor, estimate)
    >>> colors.mean(axis=(0, 1)).round(2), info.title
    (array([0.3, 0.2, 0.1], dtype=float32), 'maximum likelihood, color differences')
    """
    start = time.perf_counter()
    mosaic: Mosaic = sensor.mosaic
    method = choose_demosaicing(mosaic, demosaicing)
    prepared, gray = prepare_data(
        data, sensor, trials, channel_axis, may_differ=True, takes_mosaics=True
    )
    images = gray_images(prepared)
    if images.layout.channel_axis is not None:
        raise ValueError(
            "data: expected gray bits or counts, because the pixels of a mosaic have one color "
            "each, got color channels; sensor.replace(mosaic=None) is a sensor of color channels"
        )
    found: list[Image] = []
    infos: list[Info] = []
    output: OutputImages | None = None
    for one in images.data:
        counted, own = _count(one, gray, threads)
        height, width = counted.counts.shape
        if output is None:
            layout = Layout((*images.layout.shape, 3), -1)
            output = OutputImages(layout, (height, width), out)
        values, infos_of_one = _estimate_values(counted, own, mosaic, estimate)
        colors = demosaic(values, mosaic, method)
        np.clip(colors, 0, sensor.max_intensity, out=colors)
        found.append(np.moveaxis(colors.astype(np.float32), -1, 0))
        infos += infos_of_one
    assert output is not None, "there is at least one image"
    info = join_infos(infos, TITLES[method], time.perf_counter() - start)
    return output.finish(np.concatenate(found)), info


def _count(one: GrayData, sensor: Sensor, threads: int | None) -> tuple[PixelCounts, Sensor]:
    """Return the counts of the pixels of one image, with their sensor, which has plain bits."""
    if sensor.has_plain_bits:
        counted = count_pixels(one, sensor, threads)
        if not counted.varies_within_pixels:
            return counted, sensor
    single = GrayImages([one], Layout()) if not isinstance(one, np.ndarray) else gray_images(one)
    merged: Any = merge_images(single, sensor, threads).data[0]
    return count_pixels(merged, merged.sensor, threads), merged.sensor


def _estimate_values(
    counted: PixelCounts, sensor: Sensor, mosaic: Mosaic, estimate: EstimatePlanes
) -> tuple[Image, list[Info]]:
    """Return the estimated intensity behind each pixel's filter, divided by its sensitivity."""
    places = mosaic.full(*counted.counts.shape)
    by_filter = mosaic.pattern.size > MAX_POSITIONS
    if by_filter and (dead := counted.dead_pixels) is not None:
        warn_about_dead_pixels(dead[None])
    values = np.zeros(counted.counts.shape, np.float32)
    infos = []
    for index, planes in _planes(places, mosaic):
        own = _plane_sensor(sensor, float(mosaic.sensitivity[index]))
        with warnings.catch_warnings():
            if by_filter:
                # The pixels of other filters are not dead.
                warnings.filterwarnings("ignore", ".*have no valid bit", JotlightWarning)
            estimates, info = estimate(_plane_data(counted, sensor, own, planes), own)
        infos.append(info)
        for plane, image in zip(planes, estimates, strict=True):
            plane.write(values, image)
    return values, infos


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


def _plane_sensor(sensor: Sensor, sensitivity: float) -> Sensor:
    """Return the sensor of the pixels of a filter, which sees white light of intensity 1 as 1."""
    return sensor.without_maps().replace(gain=sensor.gain * sensitivity)


def plane_sensors(sensor: Sensor) -> list[Sensor]:
    """Return the sensors of the planes of each filter of a mosaic; a gray sensor is its own plane.

    Examples
    --------
    >>> plane_sensors(Sensor(frames=4, mosaic="RGBW"))[-1]
    Sensor(frames=4, gain=12.0)
    """
    if sensor.mosaic is None:
        return [sensor]
    gray = sensor.replace(mosaic=None, gain=sensor.gain)
    return [_plane_sensor(gray, float(each)) for each in sensor.mosaic.sensitivity]


def _plane_data(counted: PixelCounts, sensor: Sensor, own: Sensor, planes: list[_Plane]) -> Any:
    """Return the counts of planes, (N, h, w), or merged counts if their pixels differ."""
    # Merged counts may have other numbers than the sensor.
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
        data.append(Merged(ones.astype(np.int32), trials, own, dark, efficiency))
    return data
