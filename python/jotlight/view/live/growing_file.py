"""A file of a folder whose frames are read while a program writes them."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from jotlight.errors import record_warnings
from jotlight.formats.capture import Capture
from jotlight.sensing.bits.bits import Bits
from jotlight.view.live.capture import LiveCapture
from jotlight.view.live.tails import POLL_SECONDS

STEADY_SECONDS = 0.03
"""Time in seconds without a change after which the content of a file counts as written."""

MAX_FAILURES = 3.0
"""Time in seconds after which a file counts as unreadable, if it does not change meanwhile."""

_CHUNK_FRAMES = 256

Open = Callable[[Path], Capture]


class GrowingFile:
    """A file to which a program may add frames until a later file appears.

    Parameters
    ----------
    path : Path
        The file.
    open_file : callable
        A function that opens a file.
    is_raw : bool
        Whether the file has no header, so that frames are complete as soon as their bytes are
        there.
    """

    def __init__(self, path: Path, open_file: Open, *, is_raw: bool) -> None:
        self.path, self._open, self._is_raw = path, open_file, is_raw
        self.frames = 0
        """Number of frames that were added."""
        self.error: Exception | None = None
        """Why the last attempt to read the file failed, or None."""
        self.warnings: list[str] = []
        """The warnings of the last attempt to read the file."""
        self._state: tuple[int, int] | None = None
        self._since = 0.0
        """When the file was first seen in its state."""
        self._finished: tuple[int, int] | None = None
        """The state of the file when nothing was left to read."""

    def add_new(self, capture: LiveCapture) -> bool:
        """Add the frames that were written since the last call.

        Return whether nothing is left to read: all frames were added, the file is gone, or it has
        been unreadable for a while without a change. Then `error` holds the reason.
        """
        try:
            if self._changes(capture):
                return False
            if self._state == self._finished:
                return True
            with record_warnings() as self.warnings:
                bits = self._open(self.path)
                self.error = self._add(capture, bits)
        except FileNotFoundError:
            self.error = None  # it got another name, or its frames were used and it was deleted
            return True
        except (OSError, ValueError) as error:
            self.error = error
            if time.monotonic() - self._since <= MAX_FAILURES:
                capture.stop.wait(POLL_SECONDS)
                return False
        if self.error is not None:
            capture.remark = f"cannot be read: {self.error}"
        self._finished = self._state
        return True

    def _changes(self, capture: LiveCapture) -> bool:
        """Return whether a program seems to be writing the present content of the file."""
        status = self.path.stat()
        before, state = self._state, _state(status)
        if state != before:
            self._state, self._since = state, time.monotonic()
        # A file that a program allocates before it writes its frames does not grow.
        has_grown = self._is_raw and before is not None and status.st_size > before[0]
        # The files of a backlog are old, so that reading them takes no waiting.
        if has_grown or time.time() - status.st_mtime >= STEADY_SECONDS:
            return False
        capture.stop.wait(STEADY_SECONDS)
        return _state(self.path.stat()) != state

    def _add(self, capture: LiveCapture, opened: Capture) -> ValueError | None:
        """Add the frames after those that were added, or return why they do not fit.

        If more frames wait than the memory holds, the oldest ones are not read.
        """
        try:
            bits = as_bits(opened, self.path)
            _check_frames(capture, bits, self.path)
        except ValueError as error:
            return error
        late = len(bits) - self.frames - capture.ring.capacity
        if late > 0:
            self._pass_over(capture, late)
        while self.frames < len(bits) and not capture.stop.is_set():
            part = bits.packed[self.frames : self.frames + _CHUNK_FRAMES]
            capture.ring.append(np.asarray(part))
            self.frames += len(part)
        return None

    def _pass_over(self, capture: LiveCapture, frames: int) -> None:
        """Read none of the next frames. They are dropped, unless the capture begins after them."""
        if capture.ring.frames.stop > 0:
            capture.drop(frames)
        else:
            capture.ring.skip(frames)
        self.frames += frames


def _state(status: os.stat_result) -> tuple[int, int]:
    return status.st_size, status.st_mtime_ns


def as_bits(opened: Capture, path: Path) -> Bits:
    """Return the bits of a file, or raise ValueError for counts or colors."""
    if not isinstance(opened, Bits):
        raise ValueError(f"{path}: expected bits, got counts; --unpacked reads 0 and 255 as bits")
    if len(opened.shape) != 3:
        raise ValueError(
            f"{path}: expected gray bits for a live view, got {opened.shape[3]} colors"
        )
    return opened


def _check_frames(capture: LiveCapture, bits: Bits, path: Path) -> None:
    """Raise ValueError unless the frames of a file have the size of those before."""
    expected = (*capture.ring.layout.shape, capture.ring.layout.width)
    if (*bits.packed.shape[1:], bits.width) != expected:
        height, width = bits.shape[1:]
        raise ValueError(
            f"{path}: expected frames of {expected[0]} x {expected[2]} jots, as in the files "
            f"before, got {height} x {width}"
        )
