"""Bursts of frames for alignment: bits, color bits, or stacks of counts, as planes of bits."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Mask
from jotlight.formats.capture import CountStack
from jotlight.motion.counts.dark_frames import as_spans
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.channels import channel_views
from jotlight.sensing.bits.frames import Frames, read_frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.alike_frames import require_alike_frames
from jotlight.sensing.sensor import Sensor

Planes = list[tuple[int, npt.NDArray[np.uint8]]]
"""Weights, each with packed bits of weight 1 (T, H, ceil(W / 8)). Their weighted sum are counts."""


_BYTES_AT_ONCE = 1 << 25
"""Maximum number of bytes of packed frames that are read at once."""

_SIDE = 8
"""Side of the squares whose ones the engine counts fastest."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Burst:
    """Frames of counts, which are read as planes of bits.

    A count is the sum of its binary digits times powers of two, and the bits of the channels of a
    color image are added. So bits, counts, and colors are all counted by one routine.
    """

    frames: int
    size: tuple[int, int]
    """H and W in jots."""
    trials: int
    """Number of binary readings behind a count of one frame."""
    channels: int
    """Number of color channels, 1 for gray."""
    color: bool
    """Whether the images have an axis of channels, which may have the length 1."""
    frame_bytes: int
    """Bytes of a frame."""
    read: Callable[[int, int, int | None], Planes]
    """A function of the first frame, the end, and a channel or None. It returns their planes."""
    is_in_memory: bool = False
    """Whether reading all frames takes no more time than reading some."""
    threshold: int = 1
    """q: the number of photons that make a jot report 1. A change of the light changes the ones
    as it does for this q."""
    dark: Mask | None = None
    """The frames without light, (T,), which are not counted, or None if all have light."""

    def __len__(self) -> int:
        return self.frames

    def parts(self, frames: range, channel: int | None = None) -> Iterator[tuple[range, Planes]]:
        """Yield the planes of frames in parts that fit in memory, of a channel or of their sum."""
        length = max(1, _BYTES_AT_ONCE // self.frame_bytes)
        for first in range(0, len(frames), length):
            part = frames[first : first + length]
            if part.step == 1:
                yield part, self.read(part.start, part.stop, channel)
            elif self.is_in_memory:
                planes = self.read(part[0], part[-1] + 1, channel)
                yield part, [(weight, each[:: part.step]) for weight, each in planes]
            else:
                each = [self.read(frame, frame + 1, channel) for frame in part]
                yield part, _join(each)

    def is_lit(self, frames: range) -> Mask | slice:
        """Return which of some frames have light: an index of arrays over these frames."""
        if self.dark is None:
            return slice(None)
        return ~self.dark[frames.start : frames.stop : frames.step]

    def lit_parts(
        self, frames: range, channel: int | None = None
    ) -> Iterator[tuple[range, Mask | slice, Planes]]:
        """Yield parts of frames as :meth:`parts`, with which are lit, and the planes of these."""
        for part, planes in self.parts(frames, channel):
            is_lit = self.is_lit(part)
            yield part, is_lit, [(weight, packed[is_lit]) for weight, packed in planes]

    def number_lit(self, frames: range) -> int:
        """Return how many of some frames have light."""
        lit = self.is_lit(frames)
        return len(frames) if isinstance(lit, slice) else int(lit.sum())

    @property
    def dark_spans(self) -> list[range]:
        """The spans of frames without light."""
        return [] if self.dark is None else as_spans(self.dark)

    @property
    def box(self) -> tuple[int, int]:
        """Number of rows and columns whose ones :meth:`ones` counts: almost all."""
        side = _SIDE if min(self.size) >= _SIDE else 1
        return self.size[0] // side * side, self.size[1] // side * side

    def ones(
        self, valid: npt.NDArray[np.uint8] | None, threads: int | None
    ) -> npt.NDArray[np.int64]:
        """Return the number of ones of each frame in the :attr:`box`, (T,), with a packed mask."""
        height, width = self.box
        side = _SIDE if height % _SIDE == width % _SIDE == 0 else 1
        box = slice(0, height), slice(0, -(-width // 8))
        total = np.zeros(self.frames, np.int64)
        for part, planes in self.parts(range(self.frames)):
            counts = np.zeros((len(part), height // side, width // side), np.int32)
            for weight, packed in planes:
                counted = packed[:, *box] if valid is None else packed[:, *box] & valid[box]
                engine.add_counts_of_blocks(counted, width, side, 0, 1, weight, counts, threads)
            total[part.start : part.stop] = counts.sum(axis=(1, 2))
        return total

    def counts(self, frames: range, threads: int | None) -> npt.NDArray[np.int32]:
        """Return the counts of frames without motion, (H, W)."""
        total = np.zeros(self.size, np.int32)
        for _, planes in self.parts(frames):
            for weight, packed in planes:
                total += weight * Bits(packed, self.size[1]).counts(1, threads=threads)
        return total


def _join(frames: list[Planes]) -> Planes:
    """Return the planes of single frames as planes of all of them.

    Frames of small counts have fewer planes than others.
    """
    longest = max(frames, key=len)
    empty = np.zeros_like(longest[0][1])
    return [
        (
            weight,
            np.concatenate([planes[n][1] if n < len(planes) else empty for planes in frames]),
        )
        for n, (weight, _) in enumerate(longest)
    ]


def as_burst(data: Bits | CountStack | Readings) -> Burst:
    """Return bits or counts as a burst.

    Parameters
    ----------
    data : Bits or CountStack
        T frames. Counts must state their trials. Readings of several bits raise an error that says
        what takes them.

    Raises
    ------
    TypeError
        When the data are neither bits nor a stack of counts.
    ValueError
        When the number of trials of counts is unknown, or the sum of all frames may exceed int32.
    """
    if not isinstance(data, Bits | CountStack):
        if isinstance(data, Readings):
            sensor: Any = data.sensor
            require_alike_frames(sensor)
        raise TypeError(
            "data: expected jotlight.Bits, or images of counts that jotlight.formats.open_capture "
            f"returns, got {type(data).__name__}; Bits.from_array packs frames (T, H, W) of 0 and "
            '1, and open_capture("counts.npy", counts=True) reads counts that numpy.save wrote'
        )
    burst = _burst_of_bits(data) if isinstance(data, Bits) else _burst_of_counts(data)
    if burst.trials * len(burst) >= 2**31:
        raise ValueError(
            "data: expected fewer than 2**31 readings of a pixel in all of its channels, got "
            f"{burst.trials * len(burst)}; take a part of the frames"
        )
    return burst


def _burst_of_bits(bits: Bits) -> Burst:
    frames, height, width, *channels = bits.shape

    def read(start: int, stop: int, channel: int | None) -> Planes:
        part = read_frames(bits.packed, start, stop)
        views = channel_views(part, 3)
        chosen = views if channel is None else [views[channel]]
        return [(1, np.ascontiguousarray(view)) for view in chosen]

    number = channels[0] if channels else 1
    frame_bytes = max(1, bits.packed.nbytes // frames)
    is_in_memory = not channels and not isinstance(bits.packed, Frames)
    color = bool(channels)
    return Burst(
        frames=frames,
        size=(height, width),
        trials=number,
        channels=number,
        color=color,
        frame_bytes=frame_bytes,
        read=read,
        is_in_memory=is_in_memory,
    )


def _burst_of_counts(stack: CountStack) -> Burst:
    trials = stack.trials
    if trials is None:
        raise ValueError(
            f"{stack.provenance.name}: holds counts of an unknown number of trials; pass a sensor "
            "whose K is the number of trials of the whole stack"
        )
    images = stack.images
    frames, height, width, *channels = images.shape
    number = channels[0] if channels else 1

    def read(start: int, stop: int, channel: int | None) -> Planes:
        part = np.asarray(images[start:stop])
        stack.check_range(part)
        if channels:
            part = part.sum(axis=3, dtype=np.int64) if channel is None else part[..., channel]
        digits = max(1, int(part.max()).bit_length())
        return [
            (1 << digit, np.packbits((part >> digit & 1).astype(np.uint8), axis=2))
            for digit in range(digits)
        ]

    total = trials * number
    frame_bytes = height * -(-width // 8) * total.bit_length() + images.nbytes // frames
    return Burst(
        frames=frames,
        size=(height, width),
        trials=total,
        channels=number,
        color=bool(channels),
        frame_bytes=frame_bytes,
        read=read,
    )


def refuse_pixels(sensor: Sensor) -> None:
    """Raise ValueError when the counts of a sensor are those of pixels of several jots."""
    if sensor.oversampling > 1:
        raise ValueError(
            "sensor: expected an oversampling of 1, because images of counts show pixels; pass "
            f"oversampling=1 (--oversampling 1) and frames={sensor.trials} (--frames "
            f"{sensor.trials})"
        )
