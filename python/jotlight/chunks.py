"""Ranges of frames and rows: chunks of work, and the windows of a film."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import overload

_MAX_JOTS = 1 << 26
"""Maximum number of jots in a chunk. The engine processes them in tens of milliseconds."""

_MIN_ROW_COST = 1 << 9
"""Minimum cost of a row of pixels, in jots. Each row has a fixed overhead of about this cost."""


def frame_chunks(
    frames: int, rows: int, jots_per_row: int, max_jots: int | None = None
) -> Iterator[tuple[range, range]]:
    """Yield ranges of frames and of rows that together cover all of them.

    Parameters
    ----------
    frames, rows : int
        The number of frames, and the number of rows of pixels.
    jots_per_row : int
        The number of jots in a row of pixels of one frame.
    max_jots : int, optional
        The maximum number of jots in a chunk. A chunk has at least one row, whatever its size.
        Default: a number that the engine processes in well under a second.

    Examples
    --------
    >>> list(frame_chunks(2, 3, 1024, max_jots=3072))
    [(range(0, 1), range(0, 3)), (range(1, 2), range(0, 3))]
    """
    row_cost = max(_MIN_ROW_COST, jots_per_row)
    max_jots = max_jots or _MAX_JOTS
    rows_per_chunk = max(1, min(rows, max_jots // row_cost))
    frames_per_chunk = max(1, max_jots // (rows_per_chunk * row_cost))
    for frame in range(0, frames, frames_per_chunk):
        for row in range(0, rows, rows_per_chunk):
            yield (
                range(frame, min(frame + frames_per_chunk, frames)),
                range(row, min(row + rows_per_chunk, rows)),
            )


@dataclasses.dataclass(frozen=True)
class Windows(Sequence[slice]):
    """The frames of each window. There may be too many windows for a list."""

    starts: range
    """The first frame of each window."""
    window: int
    """The number of frames of a window."""

    def __len__(self) -> int:
        return len(self.starts)

    @overload
    def __getitem__(self, index: int) -> slice: ...

    @overload
    def __getitem__(self, index: slice) -> "Windows": ...

    def __getitem__(self, index: int | slice) -> "slice | Windows":
        if isinstance(index, slice):
            return Windows(self.starts[index], self.window)
        start = self.starts[index]
        return slice(start, start + self.window)


def windows(frames: int, window: int, step: int | None = None) -> Windows:
    """Return the frames of each window as a slice: `window` frames, from every `step`-th frame on.

    Parameters
    ----------
    frames : int
        The number of frames of a capture.
    window : int
        The number of frames of a window.
    step : int, optional
        Frames from one window to the next. Default: the size of a window.

    Raises
    ------
    TypeError
        If a number is no whole number, or a bool.
    ValueError
        If the window is longer than the capture, or a number is below 1.

    Examples
    --------
    >>> [(w.start, w.stop) for w in windows(10, 4, 3)]
    [(0, 4), (3, 7), (6, 10)]
    """
    for each, value in (("window", window), ("step", window if step is None else step)):
        if isinstance(value, bool) or not hasattr(value, "__index__"):
            raise TypeError(f"{each}: expected a whole number of frames, got {value!r:.80}")
    if not 1 <= window <= frames:
        raise ValueError(f"window: expected 1 to the capture's {frames} frames, got {window}")
    step = window if step is None else step
    if step < 1:
        raise ValueError(f"step: expected 1 frame or more, got {step}")
    return Windows(range(0, frames - window + 1, step), int(window))
