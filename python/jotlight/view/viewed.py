"""What a viewer shows: a capture, its sensor, and how to open it again."""

import dataclasses
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from jotlight.formats.capture import Capture, CountStack, assumed_sensor_note
from jotlight.kept import kept_property
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.alike_frames import exposure_cycle, repeat_exposures
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor

MAX_BRIEF_BYTES = 1 << 23
"""Number of bytes of frames that are read at once, and counted by one thread in milliseconds.

On a busy machine, waiting for a second thread takes longer than the work.
"""

Frames = Capture | Readings
"""A window of frames: bits, images of counts, or readings of several bits."""

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
        Lines of Python after which ``sensor`` is the sensor of the data, whose name in them is
        :func:`variable`.
    frames : slice
        The frames of the file that the capture has.
    of_window : tuple of str
        The parameters that the user states of all frames, and that differ in a window: "gain",
        "threshold", or both.
    searches_all : bool
        Whether the sensor depends on all frames, because its hot jots are searched in them.
    facts : dict
        Further facts for the records of images: "calibration_sha256" and "hot_jots".
    """

    path: str | None = None
    _: dataclasses.KW_ONLY
    argv: tuple[str, ...] = ()
    arguments: dict[str, Any] = dataclasses.field(default_factory=dict)
    sensor_lines: tuple[str, ...] = ()
    frames: slice = dataclasses.field(default_factory=lambda: slice(None))
    of_window: tuple[str, ...] = ()
    searches_all: bool = False
    facts: dict[str, Any] = dataclasses.field(default_factory=dict)


class Viewable(Protocol):
    """A capture of which windows of frames are viewed. Its frames may grow.

    A frame is one frame of bits or readings, or one image of a stack of counts. Windows are whole
    cycles of exposures, so that all of them show a scene alike.
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
    def sensor_note(self) -> str:
        """That the sensor is assumed, and which one, or "" if the capture states it."""

    @property
    def cycle(self) -> int:
        """The number of frames after which exposures repeat, 1 for frames of one exposure."""

    @property
    def frames(self) -> range:
        """The frames that can be viewed now, which are whole cycles."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W) or (H, W, C): the shape of an image, in pixels."""

    def sensor(self, number: int) -> Sensor:
        """Return the sensor of a window of `number` frames."""

    def part(self, frames: range) -> Frames:
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
    >>> viewed = Viewed.from_data(jl.Sensor(frames=8).expose(np.full((2, 3), 0.5), rng=0))
    >>> viewed.frames, viewed.shape, viewed.sensor(4).gain
    (range(0, 8), (2, 3), 4.0)
    """

    title: str
    data: Frames
    sensor_of_all: Sensor
    """The sensor of all frames together."""
    is_range_known: bool = False
    """Whether the capture or the user states the largest intensity."""
    opening: Opening = Opening()
    sensor_note: str = ""
    """That the sensor is assumed, and which one, or "" if the capture states it."""
    is_live: bool = False

    @classmethod
    def from_data(cls, data: Bits | Readings, title: str | None = None) -> "Viewed":
        """Return bits or readings as something to view.

        Bits without a sensor are taken for those of a plain one.

        Raises
        ------
        ValueError
            When the exposures of a bracket do not repeat.
        """
        stated = carried_sensor(data)
        sensor = Sensor(frames=len(data)) if stated is None else stated
        exposure_cycle(sensor)
        name = (title or variable(sensor)) if data.provenance is None else data.provenance.name
        note = assumed_sensor_note(sensor) if stated is None else ""
        return cls(name, data, sensor, stated is not None, sensor_note=note)

    @property
    def provenance(self) -> Provenance | None:
        """The provenance of the capture."""
        return self.data.provenance

    @kept_property
    def cycle(self) -> int:
        """The number of frames after which exposures repeat, 1 for frames of one exposure."""
        return exposure_cycle(self.sensor_of_all)

    @property
    def frames(self) -> range:
        """All frames of whole cycles."""
        return range(len(self.data) - len(self.data) % self.cycle)

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W) or (H, W, C): the shape of an image, in pixels."""
        if isinstance(self.data, CountStack):
            return tuple(self.data.images.shape[1:])
        return image_shape(self.data.shape, self.sensor_of_all)

    def sensor(self, number: int) -> Sensor:
        """Return the sensor of a window of `number` frames."""
        each = self.sensor_of_all.frames // len(self.data)
        return repeat_exposures(self.sensor_of_all, each * number)

    def part(self, frames: range) -> Frames:
        """Return a window of frames."""
        return self.data[frames.start : frames.stop]

    def facts(self) -> dict[str, Any]:
        """Return the frames."""
        return {"first": 0, "end": len(self.frames)}

    def close(self) -> None:
        """Do nothing: no thread reads the capture."""


def variable(sensor: Sensor) -> str:
    """Return the name of the data of a sensor in code that the page shows.

    Examples
    --------
    >>> variable(jl.Sensor(frames=4)), variable(jl.Sensor(frames=4, bit_depth=4))
    ('bits', 'readings')
    """
    return "readings" if sensor.bit_depth > 1 else "bits"


def image_shape(shape: tuple[int, ...], sensor: Sensor) -> tuple[int, ...]:
    """Return the shape of the image of bits (T, H, W) or (T, H, W, C), in pixels."""
    side = sensor.oversampling
    return shape[1] // side, shape[2] // side, *shape[3:]


def frame_bytes(viewed: Viewable) -> int:
    """Return the number of bytes of a frame."""
    part = viewed.part(viewed.frames[-1:])  # newer frames replace the first ones of a live capture
    if isinstance(part, Bits):
        return max(1, part.packed.nbytes)
    return max(1, part.frames.nbytes if isinstance(part, Readings) else part.images.nbytes)


def whole_cycles(viewed: Viewable, number: int) -> int:
    """Return the largest number of frames up to some number that is whole cycles, at least one."""
    return max(viewed.cycle, number - number % viewed.cycle)


def count_frames(
    viewed: Viewable, frames: range, check: Check = lambda: None
) -> npt.NDArray[np.integer]:
    """Return the counts of a window of frames, of all jots whether dead or not.

    They are the ones of bits, or the sums of readings of several bits.

    Raises
    ------
    CancelledError
        When `check` raises it, which is called several times.
    """
    part = viewed.part(frames)

    def progress(_: float) -> None:
        check()

    if isinstance(part, CountStack):
        return part.sum(progress)
    oversampling = viewed.sensor(viewed.cycle).oversampling
    if isinstance(part, Readings):
        return part.sum(oversampling=oversampling, progress=progress)
    if part.packed.nbytes > MAX_BRIEF_BYTES:
        return part.counts(oversampling, progress=progress)
    return Bits(np.asarray(part.packed), part.width).counts(oversampling, threads=1)
