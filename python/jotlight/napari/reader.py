"""The reader of napari: every format that jotlight opens."""

import dataclasses
import os
from functools import partial
from pathlib import Path
from typing import Any

from jotlight.errors import SeveralArraysError, warn
from jotlight.formats.capture import CountStack
from jotlight.formats.opening.detect import detect_format
from jotlight.formats.raw import OTHER_EXTENSIONS
from jotlight.formats.reading import as_readings, open_capture
from jotlight.napari.lazy import LayerData, Reader, make_layer
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.sensor import Sensor
from jotlight.view.viewed import Viewed

OPEN_TITLE = "Open a capture"
"""Name of the dock widget with fields for the format and for the name of an array."""

_MAX_ARRAYS = 16
"""Maximum number of arrays of a file that are tried. Each one takes a moment."""


def get_reader(path: Any) -> Reader | None:
    """Return a function that reads a capture, or None if jotlight does not detect its format.

    Raw frames have no header. For files and folders that may hold them, the function states where
    to choose the format.
    """
    single = _single_path(path)
    if single is None:
        return None
    try:
        detect_format(single)
    except OSError:
        return None
    except ValueError as error:
        return partial(_refuse_raw, reason=str(error)) if _may_be_raw(single) else None
    return read


def read(
    path: Any,
    format: str | None = None,  # noqa: A002
    key: str | None = None,
    mosaic: str | None = None,
    bit_depth: int | None = None,
    layout: str | None = None,
) -> list[LayerData]:
    """Return a layer of a capture, or of each capture in a file of several arrays.

    Images of counts need a label with their number of trials. Otherwise, the layer shows them as
    counts of the largest number that they hold.

    Parameters
    ----------
    path : path or list with one path
        A file or folder.
    format : str, optional
        One of ``jotlight.formats.FORMATS``. Default: detected from the content.
    key : str, optional
        Name of the array. Default: the only one, or the one that jotlight labeled, or else all
        that are captures.
    mosaic : str, optional
        The letters of the color filters, such as "RGGB". Default: what the capture states.
    bit_depth : int, optional
        The bits of a reading, 2 to 16, if the images are frames of such readings. Default: what the
        capture states.
    layout : str, optional
        The layout of raw frames, as :meth:`jotlight.RawLayout.parse` reads it.

    Raises
    ------
    OSError, ValueError
        When the capture cannot be read.
    """
    single = _single_path(path)
    if single is None:
        raise ValueError(f"path: expected one capture, got {path!r}")
    try:
        return [_read_array(single, format, key, mosaic, bit_depth, layout)]
    except SeveralArraysError as error:
        if key is not None or not 0 < len(error.names) <= _MAX_ARRAYS:
            raise ValueError(f"{error}; name it in Plugins > jotlight > {OPEN_TITLE}") from error
        return _read_arrays(single, format, error.names, mosaic, bit_depth)


def _read_arrays(
    path: Path,
    format: str | None,  # noqa: A002
    names: tuple[str, ...],
    mosaic: str | None,
    bit_depth: int | None,
) -> list[LayerData]:
    """Return a layer of each array that is a capture, and warn about the others."""
    layers, reasons = [], {}
    for name in names:
        try:
            layers.append(_read_array(path, format, name, mosaic, bit_depth))
        except ValueError as error:
            reasons[name] = str(error)
    if not layers:
        raise ValueError("\n".join((f"{path}: none of its arrays is a capture", *reasons.values())))
    if reasons:
        warn(f"{path.name}: left out arrays that are no captures: {', '.join(reasons)}")
    return layers


def _read_array(
    path: Path,
    format: str | None,  # noqa: A002
    key: str | None,
    mosaic: str | None,
    bit_depth: int | None,
    layout: str | None = None,
) -> LayerData:
    opened = open_capture(
        path, format=format, layout=layout, key=key, bit_depth=bit_depth, isolate=True
    )
    title = path.name if key is None else f"{path.name}: {key}"
    if isinstance(opened, Bits):
        viewed = dataclasses.replace(Viewed.from_data(opened), title=title)
    elif bit_depth is not None or opened.sensor is not None:
        viewed = Viewed.from_data(as_readings(opened, bit_depth))
        is_known = opened.sensor is not None
        viewed = dataclasses.replace(viewed, title=title, is_range_known=is_known)
    else:
        viewed = _view_counts(opened, title)
    if mosaic is not None:
        sensor = viewed.sensor_of_all
        sensor = sensor.replace(mosaic=mosaic, gain=sensor.gain)
        viewed = dataclasses.replace(viewed, sensor_of_all=sensor)
    return make_layer(viewed)


def _view_counts(stack: CountStack, name: str) -> Viewed:
    trials = stack.trials
    if trials is None:
        trials = max(1, max(int(image.max()) for image in stack))
    return Viewed(name, stack, Sensor(frames=trials * len(stack)))


def _may_be_raw(path: Path) -> bool:
    """Return whether a file, or a file in a folder, has a name that raw frames often have."""
    if not path.is_dir():
        return path.name.lower().endswith(OTHER_EXTENSIONS)
    return any(next(path.glob(pattern), None) for pattern in ("*.bin", "*/*.bin"))


def _refuse_raw(path: Any, reason: str) -> list[LayerData]:
    """Show the widget for the format, if there is a window of napari, and raise ValueError."""
    import napari

    viewer = napari.current_viewer()
    if viewer is not None:
        _, widget = viewer.window.add_plugin_dock_widget("jotlight", OPEN_TITLE)
        widget.show_path(_single_path(path))
    raise ValueError(f"{reason}; in napari, choose it in Plugins > jotlight > {OPEN_TITLE}")


def _single_path(path: Any) -> Path | None:
    """Return the only path of those that napari passes."""
    if isinstance(path, list | tuple):
        path = path[0] if len(path) == 1 else None
    return Path(path) if isinstance(path, str | os.PathLike) else None
