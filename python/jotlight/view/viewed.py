"""What a viewer shows: a capture, its sensor, and how to open it again."""

import dataclasses
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from jotlight.formats.capture import Capture
from jotlight.sensing.alike_frames import require_alike_frames
from jotlight.sensing.bits import Bits
from jotlight.sensing.pixel_counts import carried_sensor
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor

MAX_BRIEF_BYTES = 1 << 23
"""Number of bytes of bits that are read at once, and counted by one thread in a few milliseconds.

On a busy machine, waiting for a second thread takes longer than the work.
"""

Check = Callable[[], object]
"""A function that raises :class:`CancelledError` when the result is no longer wanted."""


class CancelledError(Exception):
    """The result of a computation is no longer wanted."""


class FramesGoneError(ValueError):
    """Frames of a live capture that newer ones have replaced."""


@dataclasses.dataclass(frozen=True)
class Opening:
    """How to open a capture: the words of a command line, and lines of Python.

    Parameters
    ----------
    path : str, optional
        The path as the user wrote it. None for bits in memory, which no command can open.
    argv : tuple of str
        Options of `jotlight reconstruct`, without those of the frames.
    arguments : dict
        Keyword arguments of :func:`jotlight.open`, without the frames.
    sensor_lines : tuple of str
        Lines of Python after which ``sensor`` is the sensor of ``bits``.
    frames : slice
        The frames of the file that the capture has.
    states_gain : bool
        Whether the user states the gain. It is that of all frames, so that of a window differs.
    searches_all : bool
        Whether the sensor depends on all frames, because its hot jots are searched in them.
    """

    path: str | None = None
    argv: tuple[str, ...] = ()
    arguments: dict[str, Any] = dataclasses.field(default_factory=dict)
    sensor_lines: tuple[str, ...] = ()
    frames: slice = dataclasses.field(default_factory=lambda: slice(None))
    states_gain: bool = False
    searches_all: bool = False


class Viewable(Protocol):
    """A capture of which windows of frames are viewed. Its frames may grow.

    A frame is one frame of bits, or one image of a stack of counts.
    """

    @property
    def title(self) -> str:
        """The name of the capture."""

    @property
    def provenance(self) -> Provenance | None:
        """The provenance of the capture."""

    @property
    def opening(self) -> Opening:
        """How to open the capture again."""

    @property
    def is_live(self) -> bool:
        """Whether frames may arrive."""

    @property
    def is_range_known(self) -> bool:
        """Whether the capture or the user states the largest intensity."""

    @property
    def frames(self) -> range:
        """The frames that can be viewed now."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W) or (H, W, C): the shape of an image, in pixels."""

    def sensor(self, number: int) -> Sensor:
        """Return the sensor of a window of `number` frames."""

    def part(self, frames: range) -> Capture:
        """Return a window of frames."""

    def facts(self) -> dict[str, Any]:
        """Return what changes while the capture grows, as values of JSON."""

    def close(self) -> None:
        """Stop reading a live capture."""


@dataclasses.dataclass(frozen=True)
class Viewed:
    """A capture that is complete.

    Examples
    --------
    >>> viewed = Viewed.from_bits(Sensor(frames=8).expose(np.full((2, 3), 0.5), rng=0))
    >>> viewed.frames, viewed.shape, viewed.sensor(4).gain
    (range(0, 8), (2, 3), 4.0)
    """

    title: str
    data: Capture
    sensor_of_all: Sensor
    """The sensor of all frames together."""
    is_range_known: bool = False
    """Whether the capture or the user states the largest intensity."""
    opening: Opening = Opening()
    is_live: bool = False

    @classmethod
    def from_bits(cls, bits: Bits, title: str = "bits") -> "Viewed":
        """Return bits as something to view. Without a sensor, a plain one is assumed."""
        stated = carried_sensor(bits)
        sensor = Sensor(frames=len(bits)) if stated is None else stated
        name = title if bits.provenance is None else bits.provenance.name
        return cls(name, bits, sensor, stated is not None)

    @property
    def provenance(self) -> Provenance | None:
        """The provenance of the capture."""
        return self.data.provenance

    @property
    def frames(self) -> range:
        """All frames."""
        return range(len(self.data))

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W) or (H, W, C): the shape of an image, in pixels."""
        if isinstance(self.data, Bits):
            return image_shape(self.data.shape, self.sensor_of_all)
        return tuple(self.data.images.shape[1:])

    def sensor(self, number: int) -> Sensor:
        """Return the sensor of a window of `number` frames."""
        require_alike_frames(self.sensor_of_all)
        each = self.sensor_of_all.frames // len(self.data)
        return self.sensor_of_all.replace(frames=each * number)

    def part(self, frames: range) -> Capture:
        """Return a window of frames."""
        return self.data[frames.start : frames.stop]

    def facts(self) -> dict[str, Any]:
        """Return the frames."""
        return {"first": 0, "end": len(self.data)}

    def close(self) -> None:
        """Do nothing: no thread reads the capture."""


def image_shape(shape: tuple[int, ...], sensor: Sensor) -> tuple[int, ...]:
    """Return the shape of the image of bits (T, H, W) or (T, H, W, C), in pixels."""
    side = sensor.oversampling
    return shape[1] // side, shape[2] // side, *shape[3:]


def count_frames(
    viewed: Viewable, frames: range, check: Check = lambda: None
) -> npt.NDArray[np.int32]:
    """Return the counts of a window of frames, of all jots whether dead or not.

    Raises
    ------
    CancelledError
        When `check` raises it, which is called several times.
    """
    part = viewed.part(frames)

    def progress(_: float) -> None:
        check()

    if isinstance(part, Bits):
        oversampling = viewed.sensor(len(frames)).oversampling
        if part.packed.nbytes > MAX_BRIEF_BYTES:
            return part.counts(oversampling, progress=progress)
        return Bits(np.asarray(part.packed), part.width).counts(oversampling, threads=1)
    return part.sum(progress)
