"""The CRC-32 of the frames of a capture, computed while they are read for another purpose."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from isal import isal_zlib

from jotlight.formats.capture import Capture, frames_of, with_frames
from jotlight.sensing.bits.frames import Frames, read_in_chunks


def with_checksum(data: Capture) -> tuple[Capture, Callable[[], tuple[int, int]]]:
    """Return the same capture, and a function that returns its size and CRC-32 after reading.

    If the frames were read in order, the function reads nothing. Otherwise it reads those that are
    missing.

    Examples
    --------
    >>> import zlib
    >>> bits, checksum = with_checksum(jl.Bits(np.full((3, 1, 1), 7, np.uint8)))
    >>> checksum() == (3, zlib.crc32(bytes([7, 7, 7])))
    True
    """
    watched, checksum = _watch(frames_of(data))
    return with_frames(data, watched), checksum


def _watch(
    frames: npt.NDArray[Any] | Frames,
) -> tuple[npt.NDArray[Any] | Frames, Callable[[], tuple[int, int]]]:
    done, value = 0, 0

    def add(start: int, part: npt.NDArray[Any]) -> None:
        nonlocal done, value
        if start <= done < start + len(part):  # windows may overlap
            new = part[done - start :]
            value = isal_zlib.crc32(np.ascontiguousarray(new).view(np.uint8), value)
            done += len(new)

    def finish() -> tuple[int, int]:
        for place, part in read_in_chunks(frames[done:]):
            add(done, part)
            assert place.stop > 0, "progress"
        return frames.nbytes, value

    if not isinstance(frames, Frames):
        return frames, finish

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        part = frames.read(start, stop)
        add(start, part)
        return part

    return Frames(frames.shape, read, frames.dtype, frames.verify), finish
