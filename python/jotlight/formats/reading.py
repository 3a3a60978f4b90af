"""`jotlight.open`: captures of every format, read part by part as they are needed."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import whole_number_in_range
from jotlight.errors import warn
from jotlight.formats.capture import Capture, CountStack
from jotlight.formats.frames.raw_layout import RawLayout, as_layout
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.frames.scaled import unscale
from jotlight.formats.frames.with_mosaic import with_mosaic
from jotlight.formats.opening.locations import expand, is_glob
from jotlight.formats.opening.opening import read_capture
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.parameters.reading_checks import MAX_BIT_DEPTH
from jotlight.sensing.sensor import Sensor

Data = Bits | Readings | npt.NDArray[np.int32]
"""The bits, the readings of several bits, or the image of counts, of a capture."""


def open(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    layout: RawLayout | str | None = None,
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
) -> Bits | Any:
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
        (`.bin`) have no header, so their format or their layout is required.
    layout : jotlight.RawLayout or str, optional
        The layout of raw frames without a format, such as ``"256x512"``: rows and columns of bits,
        eight to a byte. :meth:`jotlight.RawLayout.parse` describes the text.
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
    mosaic : str, array_like, or jotlight.Mosaic, optional
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
        When a parameter has a wrong type.
    ValueError
        When a parameter is out of range or contradicts another one. When the format is unknown, or
        the file is truncated or holds Python objects, which are never read. When the file is a
        photograph. With `counts_scale`, when a value is not a multiple of counts_scale / trials,
        rounded or truncated.
    MissingExtraError
        When a required optional package is not installed.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "cube.npy"
    >>> np.save(path, np.packbits(np.ones((4, 6, 16), bool), axis=2))
    >>> bits = jl.open(path)
    >>> bits
    <Bits: 4 frames of 6 x 16 jots>
    >>> bits.provenance.notes[0]
    'read as bits, the most significant first, along the width'
    """
    # The type of the result cannot tell what a file holds. Most hold bits, and Any lets callers use
    # the other results without a check of their type.
    options = ReadingOptions(
        format=format,
        layout=None if layout is None else str(as_layout(layout)),
        width=width,
        frames=frames,
        rotate=rotate,
        flip=flip,
        key=key,
        counts=counts,
        unpacked=unpacked,
        isolate=isolate,
        counts_scale=counts_scale,
        trials=trials,
        bit_depth=bit_depth,
        storage_options=storage_options,
    )
    if isinstance(path, str) and is_glob(path):
        return [_open_one(each, options, mosaic) for each in expand(path, storage_options)]
    return _open_one(path, options, mosaic)


def _open_one(path: str | os.PathLike[str], options: ReadingOptions, mosaic: object) -> Data:
    """Return the bits, the readings, or the sum of the counts of one capture."""
    capture = _unscaled(path, options)
    if isinstance(capture, Bits):
        return with_mosaic(capture, mosaic)
    if options.holds_readings or capture.sensor is not None:
        return with_mosaic(as_readings(capture, options.bit_depth), mosaic)
    if mosaic is not None:
        raise ValueError(
            f"mosaic: {path} holds counts, which carry no sensor; pass it to jotlight.reconstruct, "
            "such as Sensor(frames=16, mosaic=…)"
        )
    if len(capture.images) > 1 and options.frames is None:
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


def open_capture(path: str | os.PathLike[str], **options: Any) -> Capture:
    """Return a capture as :func:`open` does, but without summing a stack of images of counts.

    Parameters
    ----------
    path, **options
        As for :func:`open`, without `mosaic`.

    Returns
    -------
    Bits or CountStack
        A `CountStack` holds T images of counts, with their ``trials`` if the file states them, or
        of readings of several bits.
    """
    return _unscaled(path, ReadingOptions(**options))


def _unscaled(path: str | os.PathLike[str], options: ReadingOptions) -> Capture:
    """Return a capture, and the counts of means of frames."""
    capture = read_capture(path, options)
    if options.counts_scale is None:
        return capture
    return unscale(capture, options.counts_scale, options.trials)
