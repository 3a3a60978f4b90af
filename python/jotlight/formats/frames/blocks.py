"""Frames that are stored in blocks, of which a file yields a part only by decoding the whole."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits.frames import Frames


def read_by_blocks(frames: Frames, length: int, max_bytes: int | None = None) -> Frames:
    """Return the same frames, of which each block is read once when they are read in order.

    A block that is read in parts stays in memory until its last frame is read.

    Parameters
    ----------
    frames : Frames
    length : int
        Number of frames in a block. The last block may be shorter.
    max_bytes : int, optional
        Larger blocks are divided, and so they are read several times. Default: no limit.

    Examples
    --------
    >>> def read(start, stop):
    ...     print(f"reads {start} to {stop}")
    ...     return np.zeros((stop - start, 1, 1), np.uint8)
    >>> frames = read_by_blocks(Frames((9, 1, 1), read), 4)
    >>> for start in range(0, 9, 3):
    ...     part = frames.read(start, start + 3)
    reads 0 to 4
    reads 4 to 8
    reads 8 to 9
    """
    length = max(1, min(length, len(frames)))
    if max_bytes is not None and (size := length * frames[:1].nbytes) > max_bytes:
        length = -(-length // -(-size // max_bytes))
    kept: dict[int, npt.NDArray[Any]] = {}  # the last block, by its first frame

    def read_part(start: int, stop: int) -> npt.NDArray[Any]:
        """Return frames of one block."""
        first = start - start % length
        block = kept.get(first)
        if block is None:
            kept.clear()  # before the next block needs memory
            block = kept[first] = frames.read(first, min(first + length, len(frames)))
        if stop == first + len(block):
            kept.pop(first, None)
        return block[start - first : stop - first].copy()

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        first = -(-start // length) * length
        last = stop if stop == len(frames) else stop - stop % length
        if first > last:
            return read_part(start, stop)
        # Complete blocks are read at once, between parts of the blocks before and after them.
        parts = [read_part(start, first)] if start < first else []
        if first < last or start == stop:
            parts.append(frames.read(first, last))
        if last < stop:
            parts.append(read_part(last, stop))
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    return Frames(frames.shape, read, frames.dtype, frames.verify)
