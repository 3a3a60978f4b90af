"""The opening of a capture: its file, its format, and what it holds."""

import functools
import os
from pathlib import Path
from typing import Any

from jotlight.errors import SeveralArraysError
from jotlight.formats.capture import Capture, CountStack, frames_of, with_frames
from jotlight.formats.files.file_systems import url_state
from jotlight.formats.format import Format
from jotlight.formats.frames.packing import pack_stack
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.frames.selection import select
from jotlight.formats.opening.detect import detect_format
from jotlight.formats.opening.locations import check_exists, files_state, is_url
from jotlight.formats.opening.remote import LocalCopy
from jotlight.formats.registry import FORMATS
from jotlight.parameter_names import check_choice
from jotlight.paths import as_path
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames


def read_capture(path: str | os.PathLike[str], options: ReadingOptions) -> Capture:
    """Return the bits of a capture, or its images of counts or readings as they are stored.

    A stack of counts is not summed, and means of frames are not yet divided by their scale.

    Raises
    ------
    OSError, ValueError
        As for :func:`jotlight.open`.
    """
    capture = _open(path, options)
    return capture if options.region is None else capture[:, *options.region]


def _open(path: str | os.PathLike[str], options: ReadingOptions) -> Capture:
    """Return all rows and columns of a capture. Copies of its frames open the file again."""
    if isinstance(path, str) and is_url(path):
        return _open_url(path, options)
    if options.storage_options is not None:
        raise ValueError(f"storage_options: are for URLs, not for {path}")
    path = as_path(path, 'jotlight.open("capture.npy")')
    absolute = path.absolute()
    capture = _open_once(path, options)
    frames = frames_of(capture)
    if isinstance(frames, Frames):
        frames.set_origin(functools.partial(_open_data, absolute, files_state(absolute), options))
    return capture


def _open_url(url: str, options: ReadingOptions) -> Capture:
    """Return the capture at a URL."""
    copy = LocalCopy(url, options.storage_options)
    with copy.named_in_errors():
        capture = _open_once(copy.path, options)
    state, frames = url_state(url, options.storage_options), frames_of(capture)
    if not isinstance(frames, Frames):
        return capture
    # The local copy lives as long as these functions.
    read = copy.named_in_errors()(frames.read)
    verify = copy.named_in_errors()(frames.verify)
    kept = Frames(frames.shape, read, frames.dtype, verify)
    kept.set_origin(functools.partial(_open_url_data, url, state, options))
    return with_frames(capture, kept)


def _open_url_data(url: str, state: tuple[int, int], options: ReadingOptions) -> Any:
    """Return the frames at a URL, which a copy in another process opens again."""
    if url_state(url, options.storage_options) != state:
        raise ValueError(f"{url}: a file has changed since it was opened")
    return frames_of(_open_url(url, options))


def _open_data(path: Path, state: tuple[int, int, int], options: ReadingOptions) -> Any:
    """Return the frames of a capture, which a copy in another process opens again.

    Raises
    ------
    ValueError
        When the files have changed since the capture was opened.
    """
    if files_state(path) != state:
        raise ValueError(f"{path}: a file has changed since it was opened")
    return frames_of(_open(path, options))


def _open_once(path: Path, options: ReadingOptions) -> Capture:
    """Return a capture whose copies hold its content."""
    if options.format is not None:
        check_choice("format", options.format, FORMATS)
    check_exists(path)
    entry = FORMATS[_format_of(path, options)]
    counts, unpacked, width = options.takes_counts, options.unpacked, options.width
    _check_options(path, entry, options)
    try:
        capture = entry.open(path, options)
        if unpacked and isinstance(capture, CountStack):
            capture = pack_stack(capture)
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
    stated = capture.sensor if isinstance(capture, CountStack) else None
    if counts and not options.holds_readings and stated is not None:
        what = "counts_scale= (--counts-scale)" if options.holds_means else "counts=True (--counts)"
        raise ValueError(
            f"counts: {path} states readings of {stated.bit_depth} bits, not counts; leave out "
            f"{what}"
        )
    if width is not None:
        actual = capture.images.shape[2] if isinstance(capture, CountStack) else capture.width
        if width != actual:
            raise ValueError(f"width: expected {actual}, the width of {path}, got {width}")
    selected = select(capture, options)
    data = frames_of(selected)
    if entry.verify is not None and isinstance(data, Frames):
        data.verify = functools.partial(entry.verify, path)
    return selected


def _format_of(path: Path, options: ReadingOptions) -> str:
    """Return the name of the format of a capture."""
    return options.format or ("raw" if options.layout else detect_format(path))


def _check_options(path: Path, entry: Format, options: ReadingOptions) -> None:
    """Raise ValueError for options that do not apply to a format."""
    if options.key is not None and not entry.has_keys:
        raise ValueError(
            f"key: names an array in a file of several, but {path} ({entry.name}) has one"
        )
    if options.unpacked and entry.fixed_layout:
        raise ValueError(
            f"unpacked: is for bits in arrays and images, not for {path} ({entry.name})"
        )
