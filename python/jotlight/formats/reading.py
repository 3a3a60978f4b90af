"""`jotlight.open`: captures of every format, read part by part as they are needed."""

from __future__ import annotations

import dataclasses
import functools
import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.argument_types import as_path
from jotlight.checks import whole_number, whole_number_in_range
from jotlight.errors import SeveralArraysError, warn
from jotlight.formats.capture import Capture, CountStack, frames_of, with_frames
from jotlight.formats.detect import detect_format
from jotlight.formats.file_systems import url_state
from jotlight.formats.format import Format, OpenOptions
from jotlight.formats.locations import check_exists, expand, files_state, is_glob, is_url
from jotlight.formats.packing import pack_stack
from jotlight.formats.registry import FORMATS
from jotlight.formats.remote import LocalCopy
from jotlight.formats.scaled import unscale
from jotlight.formats.selection import select
from jotlight.formats.with_mosaic import with_mosaic
from jotlight.parameter_names import check_choice
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames
from jotlight.sensing.reading_checks import MAX_BIT_DEPTH
from jotlight.sensing.readings import Readings
from jotlight.sensing.sensor import Sensor

Data = Bits | Readings | npt.NDArray[np.int32]
"""The bits, the readings of several bits, or the image of counts, of a capture."""


def open(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    width: int | None = None,
    frames: slice | None = None,
    rotate: int = 0,
    flip: str | None = None,
    key: str | None = None,
    counts: bool | None = None,
    unpacked: bool | None = None,
    isolate: bool = False,
    counts_scale: float | None = None,
    trials: int | None = None,
    bit_depth: int | None = None,
    mosaic: object = None,
    storage_options: dict[str, Any] | None = None,
) -> Data | list[Data]:
    """Return the bits, or the image of counts, in a file or folder of any size.

    Bits are read from their files when they are needed.

    Parameters
    ----------
    path : path
        A file, or a folder of files; a URL that fsspec supports, such as ``s3://bucket/a.npy``; or
        a glob of many captures, such as ``captures/*.npy``. Files that belong to a capture, such as
        maps of its sensor, are left out, except at URLs. Captures at URLs are read in ranges,
        except for those compressed by gzip, which are fetched as a whole.
    format : str, optional
        One of ``jotlight.formats.FORMATS``. Default: detected from the content. Raw frames
        (`.bin`) have no header, so their format is required.
    width : int, optional
        True width in jots. Default: the width that the file states, or else a multiple of 8.
    frames : slice, optional
        The frames to use, such as ``slice(100, 200)``. Default: all.
    rotate : int
        Degrees counterclockwise, a multiple of 90, in addition to the rotation of the format.
    flip : {"horizontal", "vertical"}, optional
        Exchange left and right, or top and bottom, after the rotation.
    key : str, optional
        Name of the array, for a file that holds several.
    counts : bool, optional
        Whether the numbers are counts (True) or bits (False). By default, three kinds of arrays are
        bits: those that jotlight labeled as bits, uint8 (T, H, W / 8) in a `.npy`, and bool
        (T, H, W). All others are counts. uint8 (H, W, 3) and (H, W, 4) in a `.npy`, which may be
        a photograph in color, require `counts`.
    unpacked : bool, optional
        Whether each number is one bit, as 0 and 1 or 0 and 255 (True), or each byte holds eight
        bits (False). Default: each byte holds eight bits, but frames that look unpacked are
        refused.
    isolate : bool
        Whether to read HDF5 and MATLAB 7.3 files in a child process, which takes 0.2 s. Damaged
        files can crash the HDF5 library. With a child process, the crash becomes a ValueError, of
        this function or when the bits are read later.
    counts_scale : float, optional
        For images that hold the means of frames: the value of a pixel that is 1 in all frames, such
        as 255, or 1 for floats. The result is the counts. Requires `trials`.
    trials : int, optional
        Number of frames of which each value is the mean. Only with `counts_scale`.
    bit_depth : int, optional
        For images that are frames of readings of several bits: the bits of a reading, 2 to 16.
        Default: as the file states, and otherwise images are counts.
    mosaic : str, array_like, or jotlight.sensing.mosaic.Mosaic, optional
        The color filters of the pixels, such as ``"RGGB"``, as :class:`jotlight.Sensor` takes them.
        Bits then carry a sensor, with the frames of the file if it states none. Default: as the
        file states, and otherwise gray.
    storage_options : dict, optional
        Options of the file system of a URL, as in dask and pandas, such as ``{"anon": True}``.

    Returns
    -------
    list
        For a glob, one of the following for each capture, in the order of their names.
    Bits
        The bits. Their ``provenance`` states what was assumed.
    Readings
        Frames of readings of several bits, if `bit_depth` or the file states them.
    ndarray of int32, shape (H, W) or (H, W, C)
        The counts. A stack of images is summed, with a warning unless `frames` is passed.

    Raises
    ------
    OSError
        When the file cannot be read.
    TypeError
        When `frames` is not a slice.
    ValueError
        When the format is unknown, or the file is truncated or holds Python objects, which are
        never read. When the file is a photograph. With `counts_scale`, when a value is not a
        multiple of counts_scale / trials, rounded or truncated.
    MissingExtraError
        When a required optional package is not installed.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "cube.npy"
    >>> np.save(path, np.packbits(np.ones((4, 6, 16), bool), axis=2))
    >>> bits = open(path)
    >>> bits
    <Bits: 4 frames of 6 x 16 jots>
    >>> bits.provenance.notes[0]
    'read as bits, the most significant first, along the width'
    """
    if trials is not None and counts_scale is None:
        raise ValueError(
            "trials: states the frames of each mean, together with counts_scale; counts themselves "
            "need Sensor(frames=...)"
        )
    options = {name: value for name, value in locals().items() if name != "path"}
    if isinstance(path, str) and is_glob(path):
        opened = (open(each, **options) for each in expand(path, storage_options))
        return [each for each in opened if not isinstance(each, list)]
    capture = open_capture(
        path,
        format=format,
        width=width,
        frames=frames,
        rotate=rotate,
        flip=flip,
        key=key,
        counts=True if (counts_scale or bit_depth) and counts is None else counts,
        unpacked=unpacked,
        isolate=isolate,
        means=counts_scale is not None,
        readings=bit_depth is not None,
        storage_options=storage_options,
    )
    if counts_scale is not None:
        capture = unscale(capture, counts_scale, trials)
    if isinstance(capture, Bits):
        return with_mosaic(capture, mosaic)
    if bit_depth is not None or capture.sensor is not None:
        return with_mosaic(as_readings(capture, bit_depth), mosaic)
    if mosaic is not None:
        raise ValueError(
            f"mosaic: {path} holds counts, which carry no sensor; pass it to jotlight.reconstruct, "
            "such as Sensor(frames=16, mosaic=…)"
        )
    if len(capture.images) > 1 and frames is None:
        number, notes = len(capture.images), capture.provenance.notes
        warn("; ".join([f"{path}: the result is the sum of its {number} images of counts", *notes]))
    return capture.sum()


def as_readings(stack: CountStack, bit_depth: int | None) -> Readings:
    """Return images as frames of readings of several bits, which are stated or those of the file.

    Raises
    ------
    ValueError
        When the bits of a reading are out of range or contradict the file, or readings exceed them.
    """
    if bit_depth is None:
        return stack.readings()
    depth = whole_number_in_range("bit_depth", bit_depth, 2, MAX_BIT_DEPTH)
    stack.check_bit_depth(depth)
    if stack.sensor is not None:
        return stack.readings()
    return stack.readings(Sensor(frames=len(stack), bit_depth=depth))


def open_capture(
    path: str | os.PathLike[str],
    *,
    storage_options: dict[str, Any] | None = None,
    **options: Any,
) -> Capture:
    """Return a capture as :func:`open` does, but without summing a stack of images of counts.

    Parameters
    ----------
    path, storage_options, **options
        As for :func:`open`.

    Returns
    -------
    Bits, Readings, or CountStack
        A `CountStack` holds T images of counts, with their ``trials`` if the file states them.
    """
    if isinstance(path, str) and is_url(path):
        return _open_url(path, storage_options, options)
    if storage_options is not None:
        raise ValueError(f"storage_options: are for URLs, not for {path}")
    path = as_path(path, 'jotlight.open("capture.npy")')
    absolute = path.absolute()
    capture = _open_once(path, **options)
    frames = frames_of(capture)
    if isinstance(frames, Frames):
        frames.set_origin(functools.partial(_open_data, absolute, files_state(absolute), **options))
    return capture


def _open_url(url: str, storage_options: dict[str, Any] | None, options: dict[str, Any]) -> Capture:
    """Return the capture at a URL."""
    copy = LocalCopy(url, storage_options)
    with copy.named_in_errors():
        capture = _open_once(copy.path, **options)
    state, frames = url_state(url, storage_options), frames_of(capture)
    if not isinstance(frames, Frames):
        return capture
    # The local copy lives as long as these functions.
    read = copy.named_in_errors()(frames.read)
    verify = copy.named_in_errors()(frames.verify)
    kept = Frames(frames.shape, read, frames.dtype, verify)
    kept.set_origin(functools.partial(_open_url_data, url, state, storage_options, **options))
    return with_frames(capture, kept)


def _open_url_data(
    url: str, state: tuple[int, int], storage_options: dict[str, Any] | None, **options: Any
) -> Any:
    """Return the frames at a URL, which a copy in another process opens again."""
    if url_state(url, storage_options) != state:
        raise ValueError(f"{url}: a file has changed since it was opened")
    return frames_of(_open_url(url, storage_options, options))


def _open_data(path: Path, state: tuple[int, int, int], **options: Any) -> Any:
    """Return the frames of a capture, which a copy in another process opens again.

    Raises
    ------
    ValueError
        When the files have changed since the capture was opened.
    """
    if files_state(path) != state:
        raise ValueError(f"{path}: a file has changed since it was opened")
    return frames_of(open_capture(path, **options))


def _open_once(
    path: Path,
    *,
    format: str | None = None,
    width: int | None = None,
    frames: slice | None = None,
    rotate: int = 0,
    flip: str | None = None,
    key: str | None = None,
    counts: bool | None = None,
    unpacked: bool | None = None,
    isolate: bool = False,
    means: bool = False,
    readings: bool = False,
) -> Capture:
    """Return a capture whose copies hold its content."""
    if format is not None:
        check_choice("format", format, FORMATS)
    check_exists(path)
    entry = FORMATS[format or detect_format(path)]
    width = None if width is None else whole_number("width", width, 1)
    if readings and (unpacked or counts is False):
        raise ValueError(
            "bit_depth: is for images of readings, but bits are requested; leave out unpacked=True "
            "(--unpacked) and counts=False (--bits)"
        )
    packed = unpacked is False
    options = OpenOptions(key, counts, width, floats=means, packed=packed, isolate=isolate)
    _check_options(path, entry, options, unpacked)
    try:
        if unpacked:
            options = dataclasses.replace(options, counts=True, width=None, floats=True)
            capture = entry.open(path, options)
            capture = pack_stack(capture) if isinstance(capture, CountStack) else capture
        else:
            capture = entry.open(path, options)
    except ValueError as error:
        if str(path) in str(error):
            raise
        text = f"{path}: {str(error).removeprefix(f'{path.name}: ')}"
        if isinstance(error, SeveralArraysError):
            raise SeveralArraysError(text, error.names) from error
        raise ValueError(text) from error
    if not unpacked and counts is not None and counts == isinstance(capture, Bits):
        content = (
            "bits" if counts else "counts; unpacked=True (--unpacked) reads each number as a bit"
        )
        raise ValueError(f"counts: {path} ({entry.name}) holds {content}")
    if counts and not readings and isinstance(capture, CountStack) and capture.sensor is not None:
        raise ValueError(
            f"counts: {path} states readings of {capture.sensor.bit_depth} bits, not counts; leave "
            f"out {'counts_scale= (--counts-scale)' if means else 'counts=True (--counts)'}"
        )
    if width is not None:
        actual = capture.images.shape[2] if isinstance(capture, CountStack) else capture.width
        if width != actual:
            raise ValueError(f"width: expected {actual}, the width of {path}, got {width}")
    selected = select(capture, frames, rotate, flip, key)
    data = frames_of(selected)
    if entry.verify is not None and isinstance(data, Frames):
        data.verify = functools.partial(entry.verify, path)
    return selected


def _check_options(path: Path, entry: Format, options: OpenOptions, unpacked: bool | None) -> None:
    """Raise ValueError for options that do not apply to a format, or contradict each other."""
    if options.key is not None and not entry.has_keys:
        raise ValueError(
            f"key: names an array in a file of several, but {path} ({entry.name}) has one"
        )
    if unpacked and options.counts:
        raise ValueError(
            "counts: expected at most one of counts and unpacked, got both (--counts, --unpacked)"
        )
    if unpacked and entry.fixed_layout:
        raise ValueError(
            f"unpacked: is for bits in arrays and images, not for {path} ({entry.name})"
        )
