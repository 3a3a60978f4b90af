"""Counts along a motion."""

import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import AnyArray
from jotlight.motion.counts.jots import SeenJots

_REMAINDER_PIXELS = 16
"""Number of pixels of a row for which the engine returns one remainder."""

_BYTES_AT_ONCE = 1 << 23
"""Number of bytes of sums that are added together. They fit into the cache."""


@dataclasses.dataclass
class Sums:
    """Counts along a motion. They can be added.

    Parameters
    ----------
    ones, trials : ndarray of int32, shape (H, W)
        N and D: the numbers of ones and of valid bits of each pixel.
    remainders : ndarray of float32, shape (H, 2, ceil(W / 16))
        The shift minus the displacement, in rows and columns: the sum over the frames of its mean
        over 16 pixels of a row.
    frames : int
        Number of frames.
    jots : SeenJots, optional
        Sums of the efficiency and the dark counts over the bits, if the jots differ.
    """

    ones: AnyArray
    trials: AnyArray
    remainders: npt.NDArray[np.float32]
    frames: int
    jots: SeenJots | None = None

    @classmethod
    def zeros(cls, size: tuple[int, int]) -> Self:
        """Return sums over no frames."""
        remainders = np.zeros((size[0], 2, -(-size[1] // _REMAINDER_PIXELS)), np.float32)
        return cls(np.zeros(size, np.int32), np.zeros(size, np.int32), remainders, 0)

    @classmethod
    def empty(cls, size: tuple[int, int], frames: int) -> Self:
        """Return sums over some frames, whose values must be written."""
        remainders = np.empty((size[0], 2, -(-size[1] // _REMAINDER_PIXELS)), np.float32)
        return cls(np.empty(size, np.int32), np.empty(size, np.int32), remainders, frames)

    def copy(self) -> "Sums":
        """Return a copy of the sums, whose arrays may be changed."""
        arrays = self.ones.copy(), self.trials.copy(), self.remainders.copy()
        return Sums(*arrays, self.frames, self.jots)

    @classmethod
    def total(
        cls,
        parts: Iterable["Sums"],
        threads: int | None = None,
        size: tuple[int, int] | None = None,
    ) -> "Sums":
        """Return the sum of sums.

        A generator of them holds only a few at a time. `threads` is the number of threads, by
        default all. There may be no sums if their size (H, W) is given.
        """
        parts = iter(parts)
        first = next(parts, None)
        if first is None:
            if size is None:
                raise ValueError("parts: expected one or more, or their size")
            return cls.zeros(size)
        total = first.copy()
        number = max(1, _BYTES_AT_ONCE // max(1, total.ones.nbytes + total.trials.nbytes))
        while few := list(itertools.islice(parts, number)):
            engine.add_counts([part.ones for part in few], total.ones, threads)
            engine.add_counts([part.trials for part in few], total.trials, threads)
            for part in few:
                total.remainders += part.remainders
                total.frames += part.frames
                total.jots = _add(total.jots, part.jots)
        return total

    @classmethod
    def select(cls, parts: Sequence["Sums"], labels: npt.NDArray[np.uint8]) -> "Sums":
        """Return the sums whose pixels are those of the part that their label (H, W) selects.

        All parts are sums over the same frames.
        """
        total = cls.zeros((labels.shape[0], labels.shape[1]))
        total.frames = parts[0].frames
        starts = np.arange(0, labels.shape[1], _REMAINDER_PIXELS)
        widths = np.diff(starts, append=labels.shape[1])
        for index, part in enumerate(parts):
            chosen = labels == index
            np.copyto(total.ones, part.ones, where=chosen)
            np.copyto(total.trials, part.trials, where=chosen)
            shares = np.add.reduceat(chosen, starts, axis=1, dtype=np.float32) / widths
            total.remainders += part.remainders * shares[:, None].astype(np.float32)
            if part.jots is not None:
                total.jots = _add(total.jots, part.jots * chosen)
        return total

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(
            self.ones + other.ones,
            self.trials + other.trials,
            self.remainders + other.remainders,
            self.frames + other.frames,
            _add(self.jots, other.jots),
        )

    def __iadd__(self, other: "Sums") -> Self:
        self.ones += other.ones
        self.trials += other.trials
        self.remainders += other.remainders
        self.frames += other.frames
        self.jots = _add(self.jots, other.jots)
        return self

    def seen_along(self, change: npt.NDArray[np.float64]) -> "Sums":
        """Return the same counts with the remainders of a changed motion.

        Parameters
        ----------
        change : ndarray of float, shape (2, rows, columns)
            By how much the displacements of tile centers increase.
        """
        remainders = engine.changed_remainders(self.remainders, change, self.frames)
        return Sums(self.ones, self.trials, remainders, self.frames, self.jots)

    def without(self, ones: AnyArray, trials: AnyArray) -> "Sums":
        """Return the sums without some bits, given the numbers of ones and of all of them."""
        ones, rest = self.ones - ones, self.trials - trials
        jots = None if self.jots is None else self.jots * (rest / np.maximum(self.trials, 1))
        return dataclasses.replace(self, ones=ones, trials=rest, jots=jots)

    def add_accepted(
        self,
        other: "Sums",
        test: npt.NDArray[np.float32],
        limit: float,
        mask: npt.NDArray[np.uint8],
        threads: int | None = None,
    ) -> None:
        """Add the counts where a test (H, W) is below a limit, and set these bits of a mask."""
        counts = other.ones, other.trials, self.ones, self.trials
        engine.add_accepted(test, limit, *counts, mask, threads)
        self.remainders += other.remainders
        self.frames += other.frames
        if other.jots is not None:
            self.jots = _add(self.jots, other.jots * (test < limit))

    def real(self) -> "Sums":
        """Return the sums with counts in single precision."""
        ones, trials = (each.astype(np.float32) for each in (self.ones, self.trials))
        return dataclasses.replace(self, ones=ones, trials=trials)

    def masked(self, pixels: npt.NDArray[np.bool_]) -> "Sums":
        """Return the sums of some pixels (H, W), and 0 for the others."""
        ones, trials = self.ones * pixels, self.trials * pixels
        jots = None if self.jots is None else self.jots * pixels
        return dataclasses.replace(self, ones=ones, trials=trials, jots=jots)


def _add(first: SeenJots | None, second: SeenJots | None) -> SeenJots | None:
    """Return the sum of what was seen. None: no bits, or jots that are all alike."""
    if first is None or second is None:
        return second if first is None else first
    return first + second
