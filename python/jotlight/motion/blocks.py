"""Blocks of frames, and their counts along a motion."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any, Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.motion.burst import Burst
from jotlight.motion.frame_times import Times, locate, places_of
from jotlight.motion.jots import Jots, SeenJots
from jotlight.motion.tiles import TILE

Counts = npt.NDArray[Any]

Fields = Sequence[npt.NDArray[np.floating]] | npt.NDArray[np.floating]
"""Displacements at two or more times."""

_REMAINDER_PIXELS = 16
"""Number of pixels of a row for which the engine returns one remainder."""

_LIGHT, _PIXELS = 1.5, 1 << 16
"""Number of ones or zeros per pixel that show the motion well, in an image of 65,536 pixels."""

_MIN_FRAMES = 4
"""Minimum number of frames of a block that are counted, because each is rounded to whole pixels."""

_BYTES_AT_ONCE = 1 << 23
"""Number of bytes of sums that are added together. They fit into the cache."""

_SAMPLES_PER_PIXEL = 4
"""Number of frames, per pixel of a motion, in which the jots that pixels see are looked up."""


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

    ones: Counts
    trials: Counts
    remainders: npt.NDArray[np.float32]
    frames: int
    jots: SeenJots | None = None

    @classmethod
    def zeros(cls, size: tuple[int, int]) -> Self:
        """Return sums over no frames."""
        remainders = np.zeros((size[0], 2, -(-size[1] // _REMAINDER_PIXELS)), np.float32)
        return cls(np.zeros(size, np.int32), np.zeros(size, np.int32), remainders, 0)

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
        if size is None:
            first = next(parts)
            size = first.ones.shape[0], first.ones.shape[1]
            parts = itertools.chain([first], parts)
        total = cls.zeros(size)
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

    def without(self, ones: Counts, trials: Counts) -> "Sums":
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


@dataclasses.dataclass(frozen=True)
class Blocks:
    """A burst that is divided into blocks of consecutive frames.

    Parameters
    ----------
    burst : Burst
        T frames.
    edges : ndarray of int, shape (n + 1,)
        First frame of each block, and the number of frames.
    valid : ndarray of uint8, shape (H, ceil(W / 8)), optional
        Packed mask of the jots that are counted.
    threads : int, optional
        Number of threads.
    channel : int, optional
        The channel that is counted. Default: the sum of all channels.
    jots : Jots, optional
        The jots that are counted, if they differ.
    step : int
        Distance of the frames of a block that are counted.
    """

    burst: Burst
    edges: npt.NDArray[np.intp]
    valid: npt.NDArray[np.uint8] | None = None
    threads: int | None = None
    channel: int | None = None
    jots: Jots | None = None
    step: int = 1

    def frames(self, block: int) -> range:
        """Return the frames of a block that are counted."""
        start, end = int(self.edges[block]), int(self.edges[block + 1])
        return range(start + (min(self.step, end - start) - 1) // 2, end, self.step)

    def with_enough_light(self) -> Self:
        """Return the same blocks with every nth frame, if these suffice to align them."""
        needed = _LIGHT * max(1.0, _PIXELS / (self.size[0] * self.size[1]))
        mean, length = self.burst.mean_count, int(np.diff(self.edges).min())
        rarer = max(min(mean, self.burst.trials - mean), 1e-9)
        frames = max(_MIN_FRAMES, math.ceil(needed / rarer))
        return dataclasses.replace(self, step=max(1, length // frames))

    @functools.cached_property
    def centers(self) -> npt.NDArray[np.float64]:
        """Times of the middles of the blocks, (n,)."""
        return (self.edges[:-1] + self.edges[1:] - 1) / 2

    @property
    def size(self) -> tuple[int, int]:
        """(H, W)."""
        return self.burst.size

    @property
    def trials(self) -> int:
        """Number of binary readings behind a count of one frame."""
        return self.burst.trials // (1 if self.channel is None else self.burst.channels)

    @property
    def pattern(self) -> Jots | None:
        """The jots, if they differ or some are not counted."""
        if self.jots is not None or self.valid is None:
            return self.jots
        maps = np.ones((3, *self.size), np.float32)
        maps *= np.unpackbits(self.valid, axis=1, count=self.size[1])
        return Jots(1, (1.0, 0.0), maps)

    def count(self, frames: range, fields: Fields, times: Times) -> Sums:
        """Return the sums of some frames, whose displacements are linear between two fields.

        Parameters
        ----------
        frames : range
            The frames.
        fields : ndarray of float, shape (m, 2, rows, columns) or (m, 2, H, W)
            Displacements of tile centers or of all pixels, at two or more times.
        times : ndarray of float, shape (m,)
            These times, in increasing order.
        """
        sums = Sums.zeros(self.size)
        self.add(sums, frames, fields, times)
        if self.jots is not None:
            sums.jots = self._seen_jots(self.jots, sums.trials, frames, fields, times)
        return sums

    def _seen_jots(
        self, jots: Jots, trials: Counts, frames: range, fields: Fields, times: Times
    ) -> SeenJots:
        """Return the jots that the pixels see."""
        fields = np.ascontiguousarray(fields, np.float32)
        if not fields.any() or len(frames) == 0:
            return jots.at_rest(trials)
        index, place = locate(np.array([frames[0], frames[len(frames) // 2], frames[-1]]), times)
        ends = [
            fields[i] + np.float32(fraction) * (fields[i + 1] - fields[i])
            for i, fraction in zip(index, place, strict=True)
        ]
        path = float(abs(np.diff(ends, axis=0)).max(axis=(1, 2, 3)).sum())
        number = min(len(frames), 1 + int(_SAMPLES_PER_PIXEL * path))
        samples = (np.arange(number) + 0.5) * len(frames) / number
        index, place = locate(np.asarray(frames)[samples.astype(int)], times)
        tile = None if fields.shape[2:] == self.size else TILE
        return jots.along(trials, fields, tile, index + place, self.threads)

    def add(self, sums: Sums, frames: range, fields: Fields, times: Times) -> None:
        """Add the counts of some frames to sums, as :meth:`count` counts them."""
        fields = np.ascontiguousarray(fields, np.float32)
        if not fields.any():
            self._add_unmoved(sums, [frames])
            return
        for part, planes in self.burst.parts(frames, self.channel):
            places = places_of(part, tuple(np.asarray(times, np.float64).tolist()))
            for number, (weight, packed) in enumerate(planes):
                is_plain = weight == 1 and self.trials == 1
                target = sums if is_plain else Sums.zeros(self.size)
                engine.add_shifted_counts(
                    packed,
                    self.size[1],
                    fields,
                    None if fields.shape[2:] == self.size else TILE,
                    places,
                    self.valid,
                    target.ones,
                    target.trials,
                    target.remainders,
                    self.threads,
                )
                if not is_plain:
                    sums.ones += weight * target.ones
                    if number == 0:
                        sums.trials += self.trials * target.trials
                        sums.remainders += target.remainders
        sums.frames += len(frames)

    def count_unmoved(self, spans: Sequence[range]) -> Sums:
        """Return the sums of several spans of frames that stand still."""
        sums = Sums.zeros(self.size)
        self._add_unmoved(sums, spans)
        if self.jots is not None:
            sums.jots = self.jots.at_rest(sums.trials)
        return sums

    def _add_unmoved(self, sums: Sums, spans: Sequence[range]) -> None:
        """Add the counts of spans of frames that stand still."""
        for _, planes in itertools.chain.from_iterable(
            self.burst.parts(frames, self.channel) for frames in spans
        ):
            for weight, packed in planes:
                target = sums.ones if weight == 1 else np.zeros_like(sums.ones)
                engine.add_block_counts(
                    [packed], self.size[1], 1, self.valid, target[None], self.threads
                )
                if weight > 1:
                    sums.ones += weight * target
        frames = sum(map(len, spans))
        trials = np.int32(self.trials * frames)
        if self.valid is None:
            sums.trials += trials
        else:
            sums.trials += trials * np.unpackbits(self.valid, axis=1, count=self.size[1])
        sums.frames += frames
