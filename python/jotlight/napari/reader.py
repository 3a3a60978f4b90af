"""The readers of napari: every format that jotlight opens."""

import os
from functools import partial
from pathlib import Path
from typing import Any

from jotlight.formats.capture import CountStack
from jotlight.formats.detect import detect_format
from jotlight.formats.reading import open_capture
from jotlight.napari.lazy import LayerData, Reader, make_layer
from jotlight.sensing.bits import Bits
from jotlight.sensing.sensor import Sensor
from jotlight.view.viewed import Viewed


def get_reader(path: Any) -> Reader | None:
    """Return a function that reads a capture, or None if jotlight does not detect its format."""
    single = _single_path(path)
    if single is None:
        return None
    try:
        detect_format(single)
    except (ValueError, OSError):
        return None
    return partial(read, format=None)


def _get_raw_reader(path: Any, name: str) -> Reader | None:
    single = _single_path(path)
    is_raw = single is not None and (single.is_dir() or ".bin" in single.name.lower())
    return partial(read, format=name) if is_raw else None


def get_swissspad2_reader(path: Any) -> Reader | None:
    """Return a function that reads raw frames of SwissSPAD2, the half array."""
    return _get_raw_reader(path, "swissspad2")


def get_swissspad2_full_reader(path: Any) -> Reader | None:
    """Return a function that reads raw frames of SwissSPAD2, the full array."""
    return _get_raw_reader(path, "swissspad2-full")


def get_spad512s_reader(path: Any) -> Reader | None:
    """Return a function that reads raw frames of SPAD512S."""
    return _get_raw_reader(path, "spad512s")


def get_spad512s_sparse_reader(path: Any) -> Reader | None:
    """Return a function that reads the positions of the ones of SPAD512S."""
    return _get_raw_reader(path, "spad512s-sparse")


def read(path: Any, format: str | None = None) -> list[LayerData]:  # noqa: A002
    """Return the layer of a capture.

    Images of counts need a label with their number of trials. Otherwise, the layer shows them as
    counts of the largest number that they hold.

    Raises
    ------
    OSError, ValueError
        When the capture cannot be read.
    """
    single = _single_path(path)
    if single is None:
        raise ValueError(f"path: expected one capture, got {path!r}")
    opened = open_capture(single, format=format, isolate=True)
    if isinstance(opened, Bits):
        return [make_layer(Viewed.from_bits(opened, single.name))]
    return [make_layer(_view_counts(opened, single.name))]


def _view_counts(stack: CountStack, name: str) -> Viewed:
    trials = stack.trials
    if trials is None:
        trials = max(1, max(int(image.max()) for image in stack))
    return Viewed(name, stack, Sensor(frames=trials * len(stack)))


def _single_path(path: Any) -> Path | None:
    """Return the only path of those that napari passes."""
    if isinstance(path, list | tuple):
        path = path[0] if len(path) == 1 else None
    return Path(path) if isinstance(path, str | os.PathLike) else None
