"""Blocks of frames, and their counts along a motion."""

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.motion.tiles import TILE
from jotlight.sensing.bits import Bits

Counts = npt.NDArray[np.int32]

_REMAINDER_PIXELS = 16
"""Number of pixels of a row for which the engine returns one remainder."""


@dataclasses.dataclass
class Sums:
    """Counts along a motion. They can be added.

    Parameters
    ----------
    ones, trials : ndarray of float32, shape (H, W)
        N and D: the numbers of ones and of valid bits of each pixel.
    remainders : ndarray of float32, shape (2, H, W)
        m: the sum over the trials of the shift minus the displacement, in rows and columns.
    """

    ones: npt.NDArray[np.float32]
    trials: npt.NDArray[np.float32]
    remainders: npt.NDArray[np.float32]

    @classmethod
    def zeros(cls, size: tuple[int, int]) -> Self:
        """Return sums over no frames."""
        return cls(*(np.zeros(shape, np.float32) for shape in (size, size, (2, *size))))

    @classmethod
    def total(cls, parts: Sequence["Sums"]) -> Self:
        """Return the sum of one or more sums."""
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(*(sum(getattr(part, name) for part in parts) for name in names))

    @classmethod
    def select(cls, parts: Sequence["Sums"], labels: npt.NDArray[np.uint8]) -> "Sums":
        """Return the sums whose pixels are those of the part that their label (H, W) selects."""
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(*(np.choose(labels, [getattr(part, name) for part in parts]) for name in names))

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(
            self.ones + other.ones, self.trials + other.trials, self.remainders + other.remainders
        )


@dataclasses.dataclass(frozen=True)
class Blocks:
    """A burst that is divided into blocks of consecutive frames.

    Parameters
    ----------
    bits : Bits
        The burst, (T, H, W).
    edges : ndarray of int, shape (n + 1,)
        First frame of each block, and the number of frames.
    valid : ndarray of uint8, shape (H, ceil(W / 8)), optional
        Packed mask of the jots that are counted.
    threads : int, optional
        Number of threads.
    """

    bits: Bits
    edges: npt.NDArray[np.intp]
    valid: npt.NDArray[np.uint8] | None
    threads: int | None

    @property
    def centers(self) -> npt.NDArray[np.float64]:
        """Times of the middles of the blocks, (n,)."""
        return (self.edges[:-1] + self.edges[1:] - 1) / 2

    @property
    def size(self) -> tuple[int, int]:
        """(H, W)."""
        return self.bits.shape[1], self.bits.shape[2]

    def count(
        self,
        frames: range,
        fields: tuple[npt.NDArray[np.floating], npt.NDArray[np.floating]],
        times: tuple[float, float],
    ) -> Sums:
        """Return the sums of some frames, whose displacements are linear in time.

        Parameters
        ----------
        frames : range
            The frames.
        fields : (ndarray of float, ndarray of float), shape (2, rows, columns) or (2, H, W)
            Displacements of tile centers or of all pixels, at two times.
        times : (float, float)
            These times.
        """
        size = self.size
        ones, trials = np.zeros((2, *size), np.int32)
        blocks = -(-size[1] // _REMAINDER_PIXELS)
        remainders = np.zeros((size[0], 2, blocks), np.float32)
        first, last = (np.ascontiguousarray(field, np.float32) for field in fields)
        tile = None if first.shape[1:] == size else TILE
        part = self.bits.packed[frames.start : frames.stop, :]
        fractions = (np.arange(frames.start, frames.stop) - times[0]) / (times[1] - times[0])
        engine.add_shifted_counts(
            part,
            size[1],
            first,
            last,
            tile,
            fractions.astype(np.float32),
            self.valid,
            ones,
            trials,
            remainders,
            self.threads,
        )
        counted = trials.astype(np.float32)
        mean = np.repeat(remainders / np.float32(max(1, len(frames))), _REMAINDER_PIXELS, axis=2)
        return Sums(
            ones.astype(np.float32), counted, mean[:, :, : size[1]].swapaxes(0, 1) * counted
        )
