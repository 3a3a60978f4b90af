"""Verification of a capture: all of its checksums are compared, and all of its frames are read."""

import os
from typing import Any

from jotlight.formats.capture import frames_of
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.opening.detect import detect_format
from jotlight.formats.opening.opening import read_capture
from jotlight.formats.registry import FORMATS
from jotlight.paths import as_path
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.bits.frames import read_in_chunks


def verify_capture(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    progress: Progress = False,
    **options: Any,
) -> str:
    """Return a sentence about the checksums of a capture, after reading all of its frames.

    Parameters
    ----------
    path : path
        A file, or a folder of files.
    format : str, optional
        Name of the format. Default: detected from the content.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.
    **options
        Other options of :func:`jotlight.open`, such as `key`.

    Raises
    ------
    OSError
        When a file cannot be read.
    ValueError
        When a file differs from its checksum, or is damaged in a way that reading reveals.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "capture.npy"
    >>> jl.save(jl.Sensor(frames=3).expose([[0.5] * 13], rng=0), path)
    >>> verify_capture(path).partition("; ")[2]
    'all 3 frames are readable'
    """
    path = as_path(path, 'verify_capture("capture.npy")')
    entry = FORMATS.get(format or detect_format(path))
    checked = entry.verify(path) if entry is not None and entry.verify is not None else 0
    frames = frames_of(read_capture(path, ReadingOptions(format=format, **options)))
    with shown_progress(progress, "reading frames") as update:
        for place, _ in read_in_chunks(frames):
            update(place.stop / len(frames))
    if checked == 0:
        checksums = "there is no checksum apart from those inside the format"
    elif checked == 1:
        checksums = "1 file matches its checksum"
    else:
        checksums = f"{checked} files match their checksums"
    number = "the only frame is" if len(frames) == 1 else f"all {len(frames)} frames are"
    return f"{checksums}; {number} readable"
