"""The counts of a window that moves: a running sum."""

from jotlight.array_types import AnyIntegers
from jotlight.view.viewed import Check, FramesGoneError, Viewable, count_frames


class RunningCounts:
    """The counts of the most recent window, which the frames that enter and leave change.

    Parameters
    ----------
    viewed : Viewable
        The capture.

    Examples
    --------
    >>> from jotlight.view.viewed import Viewed
    >>> running = RunningCounts(Viewed.from_data(jl.Bits.from_array(np.ones((100, 1, 2), bool))))
    >>> running.move(range(10, 90)).tolist(), running.counted
    ([[80, 80]], 80)
    >>> running.move(range(11, 91)).tolist(), running.counted
    ([[80, 80]], 82)
    """

    def __init__(self, viewed: Viewable) -> None:
        self._viewed = viewed
        self._frames = range(0)
        self._counts: AnyIntegers | None = None
        self.counted = 0
        """Number of frames that were read."""

    def cost(self, frames: range) -> int:
        """Return the number of frames that :meth:`move` would read."""
        entering, leaving = _changes(self._frames, frames)
        changed = sum(map(len, (*entering, *leaving)))
        return len(frames) if self._counts is None else min(changed, len(frames))

    def move(self, frames: range, check: Check = lambda: None) -> AnyIntegers:
        """Return the counts of a window of frames. The array never changes later.

        Raises
        ------
        CancelledError
            When `check` raises it. The next call then continues from the window before.
        ValueError, OSError
            When the frames cannot be read.
        """
        if self._counts is not None and self.cost(frames) < len(frames):
            try:
                total = self._update(self._counts.copy(), frames, check)
            except FramesGoneError:  # a live capture has lost those that leave the window
                total = self._count(frames, check)
        else:
            total = self._count(frames, check)
        self._frames, self._counts = frames, total
        return total

    def _update(self, total: AnyIntegers, frames: range, check: Check) -> AnyIntegers:
        entering, leaving = _changes(self._frames, frames)
        for part in entering:
            total += self._count(part, check)
        for part in leaving:
            total -= self._count(part, check)
        return total

    def _count(self, frames: range, check: Check) -> AnyIntegers:
        check()
        self.counted += len(frames)
        return count_frames(self._viewed, frames, check)


def _changes(before: range, after: range) -> tuple[list[range], list[range]]:
    """Return the ranges of frames that enter a window and those that leave it.

    Examples
    --------
    >>> _changes(range(0, 10), range(4, 12))
    ([range(10, 12)], [range(0, 4)])
    >>> _changes(range(3, 6), range(0, 9))
    ([range(0, 3), range(6, 9)], [])
    """
    return _difference(after, before), _difference(before, after)


def _difference(one: range, other: range) -> list[range]:
    """Return the parts of a range that are not in another."""
    left = range(one.start, min(one.stop, max(one.start, other.start)))
    right = range(max(one.start, min(one.stop, other.stop)), one.stop)
    if not other:
        return [one]
    return [part for part in (left, right) if part]
