"""The frames of windows, and the pieces into which windows and chunks divide them."""

import dataclasses

import numpy as np
import numpy.typing as npt


@dataclasses.dataclass(frozen=True)
class Spans:
    """The frames of `number` windows of `window` frames: one from frame `start`, and each `step`.

    Examples
    --------
    >>> spans = Spans(window=4, step=3, number=3)
    >>> spans.stop, spans.starts.tolist(), spans.part(1, 3)
    (10, [0, 3, 6], Spans(window=4, step=3, number=2, start=3))
    """

    window: int
    step: int
    number: int
    start: int = 0

    @property
    def stop(self) -> int:
        """The frame after the end of the last window."""
        return self.start + (self.number - 1) * self.step + self.window

    @property
    def starts(self) -> npt.NDArray[np.int64]:
        """The first frame of each window."""
        return self.start + self.step * np.arange(self.number)

    @property
    def overlap(self) -> bool:
        """Whether a window begins before the end of the one before."""
        return self.step < self.window

    def part(self, first: int, stop: int) -> "Spans":
        """Return the windows from number `first` to `stop`."""
        return Spans(self.window, self.step, stop - first, self.start + first * self.step)

    def pieces(self, frames: range) -> list[tuple[int, int]]:
        """Return the first frame and the end of each piece of some frames of the windows.

        A piece begins or ends where a window does, or with the frames.

        Examples
        --------
        >>> Spans(window=4, step=3, number=3).pieces(range(2, 12))
        [(2, 3), (3, 4), (4, 6), (6, 7), (7, 10)]
        >>> Spans(window=2, step=5, number=2).pieces(range(7))
        [(0, 2), (5, 7)]
        """
        start, stop = max(frames.start, self.start), min(frames.stop, self.stop)
        begins = self.starts
        edges = np.unique(np.concatenate([[start, stop], begins, begins + self.window]))
        edges = edges[(edges >= start) & (edges <= stop)]
        # Between the windows of a large step, there are frames of no window.
        inside = (edges[:-1] - self.start) % self.step < self.window
        return [
            (int(a), int(b))
            for a, b, is_inside in zip(edges[:-1], edges[1:], inside, strict=True)
            if is_inside
        ]

    def ranges(self, pieces: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Return the first of the pieces of each window, and the one after its last piece.

        Examples
        --------
        >>> Spans(window=4, step=3, number=2).ranges([(0, 3), (3, 4), (4, 5), (5, 7)])
        [(0, 2), (1, 4)]
        """
        begins, ends = np.array(pieces).T
        low = np.searchsorted(begins, self.starts)
        high = np.searchsorted(ends, self.starts + self.window, side="right")
        return list(zip(low.tolist(), high.tolist(), strict=True))
