"""Blocks of frames, and their counts along a motion."""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import AnyArray
from jotlight.kept import kept_property
from jotlight.motion.counts.burst import Burst
from jotlight.motion.counts.dark_frames import as_spans
from jotlight.motion.counts.frame_times import Times, locate, places_of
from jotlight.motion.counts.jots import Jots, SeenJots
from jotlight.motion.counts.sums import Sums
from jotlight.motion.tiles import TILE
from jotlight.sensing.likelihood.reference import Jot

Fields = Sequence[npt.NDArray[np.floating]] | npt.NDArray[np.floating]
"""Displacements at two or more times."""

_LIGHT, _PIXELS = 1.5, 1 << 16
"""Number of ones or zeros per pixel that show the motion well, of 65,536 pixels."""

_MIN_FRAMES = 4
"""Minimum number of frames of a block that are counted, because each is rounded to whole pixels."""

_CENTRAL = 32
"""Number of frames whose counts show how much light there is."""

_MIN_SPAN = 4
"""Number of successive blocks with light, from which on the motion may be searched among them."""

_SAMPLES_PER_PIXEL = 4
"""Number of frames, per pixel of a motion, in which the jots that pixels see are looked up."""


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
        The number of threads.
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
        length = int(np.diff(self.edges).min())
        frames = max(_MIN_FRAMES, self.enough_frames(self.size[0] * self.size[1]))
        fewer = dataclasses.replace(self, step=max(1, length // frames))
        # A strobe may leave these frames dark, but not those between them.
        return self if (self.is_lit & ~fewer.is_lit).any() else fewer

    def enough_frames(self, pixels: float) -> int:
        """Return the number of frames that show the motion of a number of pixels well."""
        mean = self.mean_count
        rarer = max(min(mean, self.burst.trials - mean), 1e-9)
        return math.ceil(_LIGHT * max(1.0, _PIXELS / max(pixels, 1.0)) / rarer)

    @property
    def middle(self) -> int:
        """The middle frame. While a motion is estimated, displacements are 0 at this time.

        If some blocks have no light, it is the middle of the others, or as near to it as it is
        between two of them.
        """
        lit = np.flatnonzero(self.is_lit)
        if len(lit) in (0, len(self.is_lit)):
            return len(self.burst) // 2
        spans = as_spans(self.is_lit)
        least = min(_MIN_SPAN, max(map(len, spans)))
        middle = float(lit[len(lit) // 2])
        places = [float(np.clip(middle, *_inside(span))) for span in spans if len(span) >= least]
        nearest = min(places, key=lambda place: abs(place - middle))
        return int(np.interp(nearest, np.arange(len(self.edges)), self.edges))

    @property
    def half(self) -> int:
        """The number of frames around the middle that are available on each side."""
        return min(self.middle, len(self.burst) - self.middle)

    @kept_property
    def is_lit(self) -> npt.NDArray[np.bool_]:
        """Whether some counted frames of each block have light, (n,)."""
        if self.burst.dark is None:
            return np.ones(len(self.edges) - 1, bool)
        return np.array(
            [self.burst.number_lit(self.frames(block)) > 0 for block in range(len(self.edges) - 1)]
        )

    @kept_property
    def mean_count(self) -> float:
        """Mean number of ones of a jot in a frame, from the frames in the middle."""
        start = max(0, self.middle - _CENTRAL // 2)
        frames = range(start, min(start + _CENTRAL, len(self.burst)))
        lit = max(1, self.burst.number_lit(frames))
        return float(self.burst.counts(frames, self.threads).mean()) / lit

    @kept_property
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
        return Jots(1, Jot(1.0, 0.0), maps)

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
        fields = np.ascontiguousarray(fields, np.float32)
        if len(frames) > 0 and fields.any():
            sums = self._count_moved(frames, fields, times)
        else:
            sums = self._count_unmoved([frames])
        if self.jots is not None:
            sums.jots = self._seen_jots(self.jots, sums.trials, frames, fields, times)
        return sums

    def _seen_jots(
        self, jots: Jots, trials: AnyArray, frames: range, fields: Fields, times: Times
    ) -> SeenJots:
        """Return the jots that the pixels see."""
        fields = np.ascontiguousarray(fields, np.float32)
        lit = np.asarray(frames)[self.burst.is_lit(frames)]
        if not fields.any() or len(lit) == 0:
            return jots.at_rest(trials)
        index, place = locate(lit[[0, len(lit) // 2, -1]], times)
        ends = [
            fields[i] + np.float32(fraction) * (fields[i + 1] - fields[i])
            for i, fraction in zip(index, place, strict=True)
        ]
        path = float(abs(np.diff(ends, axis=0)).max(axis=(1, 2, 3)).sum())
        number = min(len(lit), 1 + int(_SAMPLES_PER_PIXEL * path))
        samples = (np.arange(number) + 0.5) * len(lit) / number
        index, place = locate(lit[samples.astype(int)], times)
        tile = None if fields.shape[2:] == self.size else TILE
        return jots.along(trials, fields, tile, index + place, self.threads)

    def _count_moved(self, frames: range, fields: npt.NDArray[np.float32], times: Times) -> Sums:
        """Return the sums of one or more frames that move, without the jots that they see."""
        total = None
        for part, is_lit, planes in self.burst.lit_parts(frames, self.channel):
            places = places_of(part, tuple(np.asarray(times, np.float64).tolist()))[is_lit]
            for number, (weight, packed) in enumerate(planes):
                sums = self._count_plane(packed, fields, places)
                if weight > 1:
                    sums.ones *= weight
                if self.trials > 1:
                    sums.trials *= self.trials
                if total is None:
                    total = sums
                elif number == 0:
                    total += sums
                else:
                    total.ones += sums.ones
        if total is None:
            raise ValueError("frames: expected one or more")
        return total

    def _count_plane(
        self,
        packed: npt.NDArray[np.uint8],
        fields: npt.NDArray[np.float32],
        places: npt.NDArray[np.float64],
    ) -> Sums:
        """Return the sums of a plane of bits at some places between the fields."""
        if len(packed) == 0:
            return Sums.zeros(self.size)
        sums = Sums.empty(self.size, len(packed))
        engine.count_shifted(
            packed,
            self.size[1],
            fields,
            None if fields.shape[2:] == self.size else TILE,
            places,
            self.valid,
            sums.ones,
            sums.trials,
            sums.remainders,
            self.threads,
        )
        return sums

    def count_unmoved(self, spans: Sequence[range]) -> Sums:
        """Return the sums of several spans of frames that stand still."""
        sums = self._count_unmoved(spans)
        if self.jots is not None:
            sums.jots = self.jots.at_rest(sums.trials)
        return sums

    def _count_unmoved(self, spans: Sequence[range]) -> Sums:
        """Return the sums of spans of frames that stand still, without the jots that they see."""
        sums = Sums.zeros(self.size)
        for _, _, planes in itertools.chain.from_iterable(
            self.burst.lit_parts(frames, self.channel) for frames in spans
        ):
            for weight, packed in planes:
                target = sums.ones if weight == 1 else np.zeros_like(sums.ones)
                engine.add_block_counts(
                    [packed], self.size[1], 1, self.valid, target[None], self.threads
                )
                if weight > 1:
                    sums.ones += weight * target
        frames = sum(map(self.burst.number_lit, spans))
        trials = np.int32(self.trials * frames)
        if self.valid is None:
            sums.trials += trials
        else:
            sums.trials += trials * np.unpackbits(self.valid, axis=1, count=self.size[1])
        sums.frames = frames
        return sums


def _inside(span: range) -> tuple[float, float]:
    """Return the first and the last edge between blocks, or the middle of a single block."""
    margin = min(1.0, len(span) / 2)
    return span.start + margin, span.stop - margin
