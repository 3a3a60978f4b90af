"""The frames of windows, and the pieces into which windows and chunks divide them."""

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class Spans:
    """The frames of the windows: `number` windows of `window` frames, one from each `step`."""

    window: int
    step: int
    number: int

    @property
    def stop(self) -> int:
        """Number of frames up to the end of the last window."""
        return (self.number - 1) * self.step + self.window

    def pieces(self, start: int, stop: int) -> list[tuple[int, int]]:
        """Return the first frame and the end of each piece of the frames from `start` to `stop`.

        Examples
        --------
        >>> Spans(window=4, step=3, number=3).pieces(2, 12)
        [(2, 3), (3, 4), (4, 6), (6, 7), (7, 10)]
        >>> Spans(window=2, step=5, number=2).pieces(0, 7)
        [(0, 2), (5, 7)]
        """
        stop = min(stop, self.stop)
        first = max(0, (start - self.window) // self.step)
        last = min(self.number - 1, stop // self.step)
        begins = np.arange(first, last + 1) * self.step
        edges = np.unique(np.concatenate([[start, stop], begins, begins + self.window]))
        edges = edges[(edges >= start) & (edges <= stop)]
        inside = edges[:-1] % self.step < self.window
        # A window that overlaps the next one ends after the next one has begun.
        inside |= self.window > self.step
        return [
            (int(a), int(b))
            for a, b, is_inside in zip(edges[:-1], edges[1:], inside, strict=True)
            if is_inside
        ]
