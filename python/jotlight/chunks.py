"""Work cut into parts, so that Ctrl-C and a progress bar need not wait for the whole."""

from collections.abc import Iterator
from typing import Any

import numpy as np

_SLAB = 1 << 26
"""Jots that the engine handles between two looks at Ctrl-C: some tens of milliseconds."""

JOTS_PER_COUNT = 1 << 28
"""Jots that it counts between two such looks: counting is faster."""

_PIXELS = 1 << 18
"""Pixels that the engine handles one by one between two looks at Ctrl-C."""

_SHORT_ROW = 1 << 9
"""A row of pixels with fewer jots takes as much time and memory as one with so many."""


def frame_chunks(
    frames: int, rows: int, jots_per_row: int, at_once: int | None = None
) -> Iterator[tuple[range, range]]:
    """Cut frames and rows into parts of which each takes well under a second."""
    cost = max(_SHORT_ROW, jots_per_row)
    at_once = at_once or _SLAB
    rows_at_once = max(1, min(rows, at_once // cost))
    frames_at_once = max(1, at_once // (rows_at_once * cost))
    for frame in range(0, frames, frames_at_once):
        for row in range(0, rows, rows_at_once):
            yield (
                range(frame, min(frame + frames_at_once, frames)),
                range(row, min(row + rows_at_once, rows)),
            )


def pixel_chunks(pixels: int, at_once: int | None = None) -> Iterator[slice]:
    """Cut pixels into parts; unless told otherwise each may take a few microseconds."""
    at_once = at_once or _PIXELS
    for start in range(0, pixels, at_once):
        yield slice(start, min(start + at_once, pixels))


def take_pixels(value: Any, chunk: slice) -> Any:
    """Return the pixels of `chunk` as a flat view of a map, or the number that all pixels share."""
    return value.reshape(-1)[chunk] if isinstance(value, np.ndarray) else value
