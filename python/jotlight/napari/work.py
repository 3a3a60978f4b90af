"""What the dock widget does, without its buttons."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.calibration import Calibration, calibrate
from jotlight.estimators.brightness import detected_photons
from jotlight.formats.reading import open_capture
from jotlight.napari.lazy import (
    INTENSITIES,
    LayerData,
    LayerSource,
    display_layer,
    make_layer,
    source_of,
)
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.slices import frames_text
from jotlight.view.alignment import merge_window
from jotlight.view.state import COUNTS
from jotlight.view.viewed import Viewed

_CHANNELS = ("red", "green", "blue", "alpha")
"""Channels of the colors of napari."""


def change_method(source: LayerSource, method: str, window: int, step: int) -> LayerData:
    """Return a layer of the same capture by another method, or with other windows."""
    return make_layer(source.viewed, window, step, method)


def align_window(source: LayerSource, index: int) -> LayerData:
    """Return a layer with one window, aligned to its middle, by the method of its layer.

    Behind a mosaic, a window in which nothing moves is shown without an alignment.
    """
    if not 0 <= index < len(source.spans):
        raise ValueError(
            f"align: expected one of the {len(source.spans)} windows of this layer, got window "
            f"{index}; move the slider back"
        )
    span, viewed = source.spans[index], source.viewed
    method = "mle" if source.method == COUNTS else source.method
    aligned = LayerSource(viewed, source.window, source.step, method)
    merged, _ = merge_window(viewed, span, method)
    image = aligned.image(index, merged)
    name = f"{viewed.title}, {frames_text(span)}, aligned, {method}"
    return display_layer(image, image, name)


def apply_calibration(
    source: LayerSource, dark: Path | None, flat: Path | None, saved: Path | None
) -> tuple[LayerData, str]:
    """Return a layer whose sensor has a calibration, and what the calibration found.

    Parameters
    ----------
    source : LayerSource
        The layer.
    dark, flat : Path, optional
        Captures in the dark and of even light, from which a calibration is made.
    saved : Path, optional
        The file of a calibration, in place of the captures.

    Raises
    ------
    OSError, ValueError
        When a file cannot be read, or does not fit the capture.
    """
    viewed = source.viewed
    if not isinstance(viewed, Viewed) or not isinstance(viewed.data, Bits):
        raise ValueError("calibration: expected a layer of bits, got one of counts or readings")
    if saved is not None:
        calibration = Calibration.load(saved)
    elif dark is not None:
        captures = [open_capture(path) for path in (dark, flat) if path is not None]
        if not all(isinstance(capture, Bits) for capture in captures):
            raise ValueError("calibration: expected bits in the dark and flat captures, got counts")
        mosaic = None if flat is None else _mosaic_of_jots(viewed)
        calibration = calibrate(*captures, mosaic=mosaic)  # type: ignore[arg-type]
    else:
        raise ValueError("calibration: expected a dark capture, or the file of a calibration")
    calibration.check_capture(viewed.data.shape[1:3], viewed.provenance)
    sensor = calibration.applied_to(viewed.sensor_of_all)
    changed = dataclasses.replace(viewed, sensor_of_all=sensor, title=f"{viewed.title}, calibrated")
    found = (
        f"dark counts: median {np.median(calibration.dark_counts):.3g} per frame\n"
        f"masked jots: {int(calibration.mask.sum())} of {calibration.mask.size}"
    )
    return make_layer(changed, source.window, source.step, source.method), found


def _mosaic_of_jots(viewed: Viewed) -> Mosaic | None:
    """Return the mosaic of a capture with a filter for each jot, as a calibration takes it."""
    sensor = viewed.sensor_of_all
    mosaic: Mosaic | None = sensor.mosaic
    if mosaic is None or sensor.oversampling == 1:
        return mosaic
    height, width = (sensor.oversampling * size for size in viewed.shape[:2])
    jots = mosaic.of_jots(height, width, sensor.oversampling)
    return dataclasses.replace(mosaic, pattern=jots)


def measure_layer(
    layer: Any, index: Sequence[int], rectangle: npt.NDArray[Any] | None = None
) -> str:
    """Return statistics of an image of a layer of napari, as lines of text.

    Parameters
    ----------
    layer : napari.layers.Image
        Any layer of images. A color layer of jotlight is measured before it was scaled and clipped.
    index : sequence of int
        The place of the image in the layer: an index for each dimension before the rows.
    rectangle : ndarray, shape (N, 2), optional
        Corners in rows and columns. Default: the whole image.

    Raises
    ------
    ValueError
        When the layer has no such image, or was derived from clipped colors, as by splitting them.
    """
    data = layer.data[0] if layer.multiscale else layer.data
    images = layer.metadata.get(INTENSITIES, data)
    if images.shape != data.shape:
        raise ValueError(
            "measure: expected a layer of intensities, got one derived from colors that are "
            "clipped for display; measure the color layer itself"
        )
    for place, size in zip(index, images.shape, strict=False):
        if not 0 <= place < size:
            raise ValueError(
                f"measure: expected one of the {size} images of this layer, got image {place}; "
                "move the slider back"
            )
    try:
        source: LayerSource | None = source_of(layer)
    except ValueError:
        source = None
    if source is not None and len(images) != len(source.spans):
        source = None  # a projection has other units
    return measure(source, np.asarray(images[tuple(index)]), rectangle)


def measure(
    source: LayerSource | None,
    image: npt.NDArray[Any],
    rectangle: npt.NDArray[Any] | None = None,
) -> str:
    """Return statistics of an image, or of a rectangle of it, as lines of text.

    Each channel of a color image has its own statistics.

    Parameters
    ----------
    source : LayerSource or None
        The capture, for units of photons.
    image : ndarray, shape (H, W) or (H, W, C)
        The image, as intensities.
    rectangle : ndarray, shape (N, 2), optional
        Corners in rows and columns. Default: the whole image.

    Examples
    --------
    >>> print(measure(None, np.array([[1.0, 3.0]])))
    pixels: 2
    mean: 2
    standard deviation: 1
    smallest: 1
    largest: 3
    mean / standard deviation: 2
    >>> print(measure(None, np.array([[[1, 2, 3], [3, 6, 9]]])).splitlines()[2])
    mean: 2, 4, 6
    """
    part = image if rectangle is None else _crop(image, rectangle)
    channels = part.shape[2] if part.ndim == 3 else 1
    values = np.asarray(part, np.float64).reshape(-1, channels)
    mean, deviation = values.mean(axis=0), values.std(axis=0)
    lines = [
        f"pixels: {len(values)}",
        f"mean: {_join(mean)}",
        f"standard deviation: {_join(deviation)}",
        f"smallest: {_join(values.min(axis=0))}",
        f"largest: {_join(values.max(axis=0))}",
    ]
    if channels > 1:
        lines.insert(1, f"channels: {', '.join(_CHANNELS[:channels])}")
    if (deviation > 0).all():
        lines.append(f"mean / standard deviation: {_join(mean / deviation)}")
    if source is not None and source.method != COUNTS:
        sensor = source.viewed.sensor(source.window)
        if np.ndim(sensor.gain):
            return "\n".join(lines)  # the photons differ from frame to frame
        photons = mean * detected_photons(sensor)
        lines.append(f"mean in photons per pixel and frame: {_join(photons)}")
        if sensor.exposure_time is not None:
            per_second = photons / sensor.exposure_time
            lines.append(f"mean in photons per second: {_join(per_second)}")
    return "\n".join(lines)


def _join(values: npt.NDArray[np.float64]) -> str:
    """Return the values of all channels as text."""
    return ", ".join(f"{value:.4g}" for value in values)


def _crop(image: npt.NDArray[Any], rectangle: npt.NDArray[Any]) -> npt.NDArray[Any]:
    corners = np.asarray(rectangle, np.float64)[:, -2:]
    low = np.clip(np.floor(corners.min(axis=0)).astype(int), 0, image.shape[:2])
    high = np.clip(np.ceil(corners.max(axis=0)).astype(int), 0, image.shape[:2])
    part = image[low[0] : high[0], low[1] : high[1]]
    if part.size == 0:
        raise ValueError("rectangle: expected one that covers a part of the image")
    return part
