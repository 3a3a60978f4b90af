"""A folder in which files with frames appear."""

import itertools
import os
import re
import time
from collections import deque
from collections.abc import Callable, Container
from pathlib import Path

import numpy as np

from jotlight.formats.capture import Capture
from jotlight.sensing.bits.bits import Bits
from jotlight.view.live.capture import LiveCapture
from jotlight.view.live.tails import POLL_SECONDS

_STEADY_SECONDS = 0.03
"""Time without a change after which a file is taken to be complete."""

_MAX_FAILURES = 3.0
"""Time in seconds in which a file may be unreadable, because it is not complete."""

_CHUNK_FRAMES = 256

_MAX_TRIED = 8
"""Number of files of which one must be readable when a folder is opened."""

_MAX_GAPS = 100
"""Number of the newest gaps whose files are recognized when they come late."""

Open = Callable[[Path], Capture]
Key = tuple[int, str]
"""The last number in the name of a file, or -1, and the name."""


def list_files(folder: Path, seen: Container[str] = ()) -> list[tuple[Key, Path]]:
    """Return the files of a folder that are not `seen`, sorted by the last number in their names.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("f10.png", "f9.png", ".hidden", "f8.png.part"):
    ...     folder.joinpath(name).touch()
    >>> [path.name for _, path in list_files(folder)]
    ['f9.png', 'f10.png']
    """
    found = []
    with os.scandir(folder) as entries:
        for entry in entries:
            # Programs write a file under such a name, and rename it when it is complete.
            is_part = entry.name.startswith(".") or entry.name.endswith((".part", ".tmp", ".json"))
            if entry.name in seen or is_part or not entry.is_file(follow_symlinks=False):
                continue
            path = folder / entry.name
            digits = re.findall(r"[0-9]+", path.stem)
            found.append(((int(digits[-1][:18]) if digits else -1, entry.name), path))
    return sorted(found)


def open_first(folder: Path, open_file: Open) -> tuple[Path, Bits]:
    """Return the newest complete file of a folder, and its bits. Wait for one.

    Raises
    ------
    OSError, ValueError
        When files have been there for a while, and none of the newest holds bits.
    """
    start = None
    while True:
        newest = [path for _, path in list_files(folder)[: -_MAX_TRIED - 1 : -1]]
        # The newest file may not be complete, so the one before it comes first.
        for path in [*newest[1:2], *newest[:1], *newest[2:]]:
            try:
                return path, as_bits(open_file(path), path)
            except (OSError, ValueError) as error:
                start = time.monotonic() if start is None else start
                if time.monotonic() - start > _MAX_FAILURES:
                    raise error
        time.sleep(POLL_SECONDS)


class FolderReader:
    """The frames of the files of a folder, as they appear.

    Files with another ending than the first one are ignored. A gap in the numbers of the names
    counts as dropped frames, and so does a file that cannot be read: as many frames as in the file
    before it. A file that appears later with a number from a gap stays dropped. Any other new file
    with a lower number begins a new sequence.

    Parameters
    ----------
    folder : Path
    open_file : callable
        A function that opens a file.
    first : Path
        The file with which the capture begins.
    bits : Bits
        Its bits.
    """

    def __init__(self, folder: Path, open_file: Open, first: Path, bits: Bits) -> None:
        self._folder, self._open = folder, open_file
        self._first, self._bits = first, bits
        files = list_files(folder)
        self._last = next(key for key, path in files if path == first)
        self._seen = {path.name for key, path in files if key <= self._last}
        self._frames = len(bits)
        self._unit: int | None = None
        """Difference of the numbers of two files: 1, or their frames if the names count frames."""
        self._gaps: deque[range] = deque(maxlen=_MAX_GAPS)

    def __call__(self, capture: LiveCapture) -> None:
        """Add frames until the capture is closed."""
        add_frames(capture, self._bits, self._first)
        while not capture.stop.is_set():
            new = list_files(self._folder, self._seen)
            if self._has_gap(new):
                # A listing may lack files that appear while it is made.
                capture.stop.wait(_STEADY_SECONDS)
                new = list_files(self._folder, self._seen)
            for key, path in self._without_backlog(capture, new):
                if path.suffix.lower() == self._first.suffix.lower():
                    self._read(capture, key, path)
                else:
                    self._seen.add(path.name)
                    capture.remark = f"{path.name}: ignored, because it is no {self._first.suffix}"
            if not new:
                capture.stop.wait(POLL_SECONDS)

    def _has_gap(self, new: list[tuple[Key, Path]]) -> bool:
        """Return whether numbers are missing between the last file and the new ones."""
        numbers = [self._last[0], *(key[0] for key, _ in new)]
        return any(b - a > (self._unit or 1) for a, b in itertools.pairwise(numbers))

    def _without_backlog(
        self, capture: LiveCapture, new: list[tuple[Key, Path]]
    ) -> list[tuple[Key, Path]]:
        """Return the newest files that fit into memory. The frames of the others are dropped."""
        fitting = max(1, capture.ring.capacity // max(1, self._frames))
        late = new[:-fitting]
        for key, path in late:
            self._seen.add(path.name)
            if path.suffix.lower() == self._first.suffix.lower():
                self._last = key
                drop(capture, self._frames)
        return new[len(late) :]

    def _read(self, capture: LiveCapture, key: Key, path: Path) -> None:
        """Add the frames of a file, and count those that are missing before it."""
        number = key[0]
        if any(number in gap for gap in self._gaps):
            self._seen.add(path.name)
            capture.remark = f"{path.name}: came late, so its frames stay dropped"
            return
        try:
            bits = wait_for_file(capture, path, self._open)
            if bits is None:
                return
            check_frames(capture, bits, path)
        except (OSError, ValueError) as error:
            bits = None
            capture.remark = f"skipped, and counted as dropped: {error}"
        self._seen.add(path.name)
        before, self._last = self._last[0], key
        if self._unit is None:
            self._unit = self._frames if number - before == self._frames else 1
        missing = (number - before - 1) // self._unit
        if before > -1 and missing > 0:
            self._gaps.append(range(before + 1, number))
            drop(capture, missing * self._frames)
        elif -1 < number < before:
            self._gaps.clear()
            capture.remark = f"{path.name}: its number is lower, so a new sequence begins"
        if bits is None:
            drop(capture, self._frames)
        else:
            add_frames(capture, bits, path)
            self._frames = len(bits)


def drop(capture: LiveCapture, frames: int) -> None:
    """Count frames as dropped."""
    capture.dropped += frames
    capture.ring.skip(frames)


def wait_for_file(capture: LiveCapture, path: Path, open_file: Open) -> Bits | None:
    """Return the bits of a file when it is complete.

    Return None if the file disappears, because it gets another name, or if the capture is closed.
    """
    start = time.monotonic()
    while not capture.stop.is_set():
        try:
            state = path.stat()
            # The files of a backlog are old, so that reading them takes no waiting.
            if time.time() - state.st_mtime < _STEADY_SECONDS:
                capture.stop.wait(_STEADY_SECONDS)
            if state.st_size > 0 and state.st_size == path.stat().st_size:
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


def check_frames(capture: LiveCapture, bits: Bits, path: Path) -> None:
    """Raise ValueError unless the frames of a file have the size of those before."""
    expected = (*capture.ring.layout.shape, capture.ring.layout.width)
    if (*bits.packed.shape[1:], bits.width) != expected:
        height, width = bits.shape[1:]
        raise ValueError(
            f"{path}: expected frames of {expected[0]} x {expected[2]} jots, as in the files "
            f"before, got {height} x {width}"
        )


def add_frames(capture: LiveCapture, bits: Bits, path: Path) -> None:
    """Add all frames of a file."""
    check_frames(capture, bits, path)
    for start in range(0, len(bits), _CHUNK_FRAMES):
        capture.ring.append(np.asarray(bits.packed[start : start + _CHUNK_FRAMES]))
