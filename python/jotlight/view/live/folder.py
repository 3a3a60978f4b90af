"""A folder in which files with frames appear."""

import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from jotlight.formats.capture import Capture
from jotlight.sensing.bits import Bits
from jotlight.view.live.capture import LiveCapture
from jotlight.view.live.tails import POLL_SECONDS

_STEADY_SECONDS = 0.03
"""Time without a change after which a file is taken to be complete."""

_MAX_FAILURES = 3.0
"""Time in seconds in which a file may be unreadable, because it is not complete."""

_CHUNK_FRAMES = 256

Open = Callable[[Path], Capture]


def list_new(folder: Path, after: tuple[int, str] | None) -> list[tuple[tuple[int, str], Path]]:
    """Return the files of a folder that come after a key, sorted by the last number in their names.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("f10.png", "f9.png", ".hidden", "f8.png.part"):
    ...     folder.joinpath(name).touch()
    >>> [path.name for _, path in list_new(folder, (8, ""))]
    ['f9.png', 'f10.png']
    """
    found = []
    for path in folder.iterdir():
        # Programs write a file under such a name, and rename it when it is complete.
        if path.name.startswith(".") or path.suffix in (".part", ".tmp", ".json"):
            continue
        digits = re.findall(r"[0-9]+", path.stem)
        key = (int(digits[-1][:18]) if digits else -1, path.name)
        if (after is None or key > after) and path.is_file() and not path.is_symlink():
            found.append((key, path))
    return sorted(found)


def read_folder(
    capture: LiveCapture,
    folder: Path,
    open_file: Open,
    last: tuple[int, str] | None,
    frames_before: int,
) -> None:
    """Add the frames of files as they appear, until the capture is closed.

    A gap in the numbers of the names counts as dropped frames, as many as in the file before it;
    `last` and `frames_before` are the key and the frames of the file that was added already.
    """
    while not capture.stop.is_set():
        new = list_new(folder, last)
        for key, path in new:
            bits = wait_for_file(capture, path, open_file)
            if bits is None:
                continue
            if last is not None and last[0] > -1 and key[0] > last[0] + 1:
                missing = (key[0] - last[0] - 1) * frames_before
                capture.dropped += missing
                capture.ring.skip(missing)
            add_frames(capture, bits, path)
            frames_before, last = len(bits), key
        if not new:
            capture.stop.wait(POLL_SECONDS)


def wait_for_file(capture: LiveCapture, path: Path, open_file: Open) -> Bits | None:
    """Return the bits of a file when it is complete.

    Return None if the file disappears, because it gets another name, or if the capture is closed.
    """
    start = time.monotonic()
    while not capture.stop.is_set():
        try:
            size = path.stat().st_size
            capture.stop.wait(_STEADY_SECONDS)
            if size > 0 and size == path.stat().st_size:
                return as_bits(open_file(path), path)
        except FileNotFoundError:
            return None
        except (OSError, ValueError):
            if time.monotonic() - start > _MAX_FAILURES:
                raise
    return None


def as_bits(opened: Capture, path: Path) -> Bits:
    """Return the bits of a file, or raise ValueError for counts or colors."""
    if not isinstance(opened, Bits):
        raise ValueError(f"{path}: expected bits, got counts; --unpacked reads 0 and 255 as bits")
    if len(opened.shape) != 3:
        raise ValueError(
            f"{path}: expected gray bits for a live view, got {opened.shape[3]} colors"
        )
    return opened


def add_frames(capture: LiveCapture, bits: Bits, path: Path) -> None:
    """Add all frames of a file."""
    expected = (*capture.ring.layout.shape, capture.ring.layout.width)
    if (*bits.packed.shape[1:], bits.width) != expected:
        height, width = bits.shape[1:]
        raise ValueError(
            f"{path}: expected frames of {expected[0]} x {expected[2]} jots, as in the files "
            f"before, got {height} x {width}"
        )
    for start in range(0, len(bits), _CHUNK_FRAMES):
        capture.ring.append(np.asarray(bits.packed[start : start + _CHUNK_FRAMES]))
