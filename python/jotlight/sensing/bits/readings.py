"""Readings of several bits, which state how many photons each jot has seen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Self, SupportsIndex, overload

import numpy as np
import numpy.typing as npt

from jotlight.checks import refuse_masked, to_array
from jotlight.errors import counted
from jotlight.notebook import card, normalize
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.bits import preview
from jotlight.sensing.bits.bits_checks import as_frames, check_fits, checked_oversampling
from jotlight.sensing.bits.channels import channel_views
from jotlight.sensing.bits.crop import OneFrame, Region, crop_frames, note_part, split_index
from jotlight.sensing.bits.frame_sequence import FrameSequence
from jotlight.sensing.bits.frames import Frames, frame_index, read_in_chunks
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.sensor_like import SensorLike
from jotlight.sensing.parameters.slices import refuse_no_frames

_SHOWN = 64
"""Number of frames of which a preview shows the mean."""


class Readings(FrameSequence):
    """Readings of several bits: numbers from 0 to 2^b - 1, one for each jot and frame.

    They are equal if their values and their sensors are, wherever they come from.

    Parameters
    ----------
    array : array_like of int or Frames, shape (T, H, W), (H, W), or (T, H, W, C)
        The readings. :class:`jotlight.sensing.bits.frames.Frames` are read from files when they are
        needed.
    sensor : Sensor
        The sensor that recorded them. Its `bit_depth` is 2 or more.
    provenance : jotlight.sensing.parameters.provenance.Provenance, optional
        The file that the readings come from.

    Raises
    ------
    TypeError, ValueError
        When the array and the sensor do not fit together, or a reading is out of range.

    Examples
    --------
    >>> readings = jl.Readings([[[0, 3]], [[1, 2]]], jl.Sensor(frames=2, bit_depth=2))
    >>> readings
    <Readings: 2 frames of 1 x 2 jots, 2 bits each, Sensor(frames=2, bit_depth=2)>
    >>> readings.sum().tolist()
    [[1, 5]]
    """

    def __init__(
        self,
        array: npt.ArrayLike | Frames,
        sensor: SensorLike,
        provenance: Provenance | None = None,
    ) -> None:
        if not hasattr(sensor, "bit_depth"):
            raise TypeError(
                "sensor: expected a jotlight.Sensor, such as Sensor(frames=16, bit_depth=4), got "
                f"{type(sensor).__name__}"
            )
        refuse_masked("readings", array)
        values: Any = array if isinstance(array, Frames) else to_array("readings", array)
        if values.dtype.kind not in "iu":
            advice = "; numpy.rint(array).astype(int) rounds floats" * (values.dtype.kind == "f")
            raise TypeError(f"readings: expected whole numbers, got {values.dtype}{advice}")
        self.frames: npt.NDArray[Any] | Frames = as_frames("readings", values)
        # A Sensor. Its module imports this one, so the type cannot be named here.
        self.sensor: Any = sensor
        self.provenance = provenance
        if sensor.bit_depth == 1:
            raise ValueError(
                "sensor: expected the bits of a reading, 2 to 16, such as "
                f"Sensor(frames={self.shape[0]}, bit_depth=4), got {sensor!r} with single bits; "
                "jotlight.Bits.from_array(array, sensor) packs single bits"
            )
        check_fits(self.shape, sensor, bit_depth=sensor.bit_depth)
        if isinstance(values, np.ndarray):
            self._check_range(values)

    @property
    def bit_depth(self) -> int:
        """Number of bits of a reading."""
        return int(self.sensor.bit_depth)

    @property
    def shape(self) -> tuple[int, ...]:
        """(T, H, W) or (T, H, W, C), in jots."""
        return tuple(self.frames.shape)

    def __iter__(self) -> Iterator[npt.NDArray[np.uint16]]:
        """Yield each frame as an array, (H, W) or (H, W, C)."""
        for start in range(len(self)):
            yield from self.read(start, start + 1)

    @overload
    def __getitem__(self, index: SupportsIndex | OneFrame) -> npt.NDArray[np.uint16]: ...
    @overload
    def __getitem__(self, index: slice | tuple[slice, ...]) -> Self: ...

    def __getitem__(self, index: Any) -> npt.NDArray[np.uint16] | Self:
        """Return one frame as an array, or a view of several, whose sensor has as many frames.

        ``readings[:, 10:40, 16:48]`` has some rows and columns of jots, as that of
        :class:`jotlight.Bits`.
        """
        frames, parts = split_index(index)
        if not isinstance(frames, slice):
            place = frame_index("readings", frames, len(self))
            return np.asarray(self[(slice(place, place + 1), *parts)].to_array()[0])
        refuse_no_frames("readings", frames, len(self))
        region = Region.of("readings", parts, self.shape, self.sensor)
        taken, sensor = self.frames[frames], self.sensor.select_frames(frames)
        if region is not None:
            taken, sensor = crop_frames(taken, region), region.crop_sensor(sensor)
        return type(self)(taken, sensor, note_part(self.provenance, frames, region, self.shape))

    def read(self, start: int, stop: int) -> npt.NDArray[np.uint16]:
        """Return the readings of the frames from `start` up to `stop` - 1.

        Returns
        -------
        ndarray of uint16, shape (N, H, W) or (N, H, W, C)

        Raises
        ------
        ValueError
            When the file holds a reading that the sensor cannot report.

        Examples
        --------
        >>> readings = jl.Readings([[[0, 3]], [[1, 2]]], jl.Sensor(frames=2, bit_depth=2))
        >>> readings.read(1, 2).tolist()
        [[[1, 2]]]
        """
        part = np.asarray(self.frames[start:stop])
        if isinstance(self.frames, Frames):
            self._check_range(part)
        return part.astype(np.uint16, copy=False)

    def to_array(self) -> npt.NDArray[np.uint16]:
        """Return all readings as an array, (T, H, W) or (T, H, W, C).

        Examples
        --------
        >>> sensor = jl.Sensor(frames=3, gain=6.0, bit_depth=4)
        >>> sensor.expose(np.full((5, 13), 0.5), rng=0).to_array().shape
        (3, 5, 13)
        """
        return self.read(0, len(self))

    def __array__(
        self, dtype: npt.DTypeLike | None = None, copy: bool | None = None
    ) -> npt.NDArray[Any]:
        """Return :meth:`to_array`, for ``numpy.asarray``."""
        return np.array(self.to_array(), dtype, copy=copy)

    def sum(
        self,
        axis: int | tuple[int, ...] | None = 0,
        *,
        oversampling: int = 1,
        progress: Progress = False,
        **options: Any,
    ) -> npt.NDArray[np.int64]:
        """Return the sum of all frames, (H, W) or (H, W, C), in the memory of a few frames.

        Parameters
        ----------
        axis : int, tuple of int, or None
            The axes that are added, as in NumPy. All but 0, the frames, need an array of all
            readings, and so do the other options of ``numpy.sum``.
        oversampling : int
            K̂: the readings of each K̂ x K̂ jots are added. Default: each jot has its own sum.
        progress : bool or callable, optional
            Whether to show a progress bar, or a function that is called repeatedly with the
            completed fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

        Raises
        ------
        TypeError, ValueError
            When K̂ is not a whole number that divides height and width.
        """
        is_first = axis in (0, (0,), -len(self.shape), (-len(self.shape),))
        if not is_first or any(value is not None for value in options.values()):
            if oversampling != 1:
                raise ValueError("oversampling: needs axis 0 and no options, to add whole frames")
            # NumPy would add them to unsigned numbers, whose differences cannot be negative.
            options["dtype"] = options.get("dtype") or np.int64
            return np.asarray(self.to_array().sum(axis, **options))
        height, width, *channels = self.shape[1:]
        side = checked_oversampling(oversampling, (height, width), "readings")
        total = np.zeros(self.shape[1:], np.int64)
        with shown_progress(progress, "adding readings") as update:
            for place, _ in read_in_chunks(self.frames):
                total += self.read(place.start, place.stop).sum(axis=0, dtype=np.int64)
                update(place.stop / len(self))
        pixels = total.reshape(height // side, side, width // side, side, *channels)
        return np.asarray(pixels.sum(axis=(1, 3)))

    def show(self, *, viewer: bool = False) -> None:
        """Show the mean reading of each jot, with matplotlib. Only the first 64 frames are read.

        Parameters
        ----------
        viewer : bool
            Whether to open a viewer with a slider instead, as :meth:`jotlight.Bits.show` does.
        """
        if viewer:
            preview.open_viewer(self)
            return
        part = self.read(0, min(len(self), _SHOWN))
        preview.show_image(normalize(part.mean(axis=0)), "the mean reading of the first frames")

    def channels(self) -> list[Self]:
        """Return the readings of each channel, (T, H, W)."""
        if len(self.shape) == 3:
            return [self]
        views = channel_views(self.frames, 3)
        return [type(self)(view, self.sensor, self.provenance) for view in views]

    def _check_range(self, values: npt.NDArray[Any]) -> None:
        highest = 2**self.sensor.bit_depth - 1
        if values.min() < 0 or values.max() > highest:
            raise ValueError(
                f"readings: expected 0 to {highest} for {self.sensor.bit_depth} bits, got "
                f"{values.min()} to {values.max()}; sensor.replace(bit_depth=...) (--bit-depth) "
                "states another number of bits"
            )

    def _repr_html_(self) -> str:
        frames, height, width, *_ = self.shape
        facts: dict[str, object] = {
            "frames": frames,
            "jots": f"{height} x {width}",
            "sensor": self.sensor,
            "image": "the mean reading of the first frames",
        }
        part = self.read(0, min(frames, _SHOWN))
        return card("Readings", facts, normalize(part.mean(axis=0)))

    def __repr__(self) -> str:
        frames, height, width, *channels = self.shape
        color = f" x {channels[0]} channels" if channels else ""
        return (
            f"<Readings: {counted(frames, 'frame')} of {height} x {width} jots{color}, "
            f"{self.sensor.bit_depth} bits each, {self.sensor!r}>"
        )


def image_of_readings(
    data: Any, sensor: SensorLike, trials: object, channel_axis: int | None
) -> Readings:
    """Return an image (H, W) of a sensor with one frame as readings of several bits."""
    if trials is not None or channel_axis is not None or sensor.trials > 1 or np.ndim(data) != 2:
        raise ValueError(
            f"data: expected jotlight.Readings, because the sensor has {sensor.bit_depth} bits per "
            f"reading, got an array of shape {np.shape(data)}; a sum of frames does not say which "
            "readings were the largest, so pass all frames: jotlight.Readings(frames, sensor)"
        )
    return Readings(data, sensor)
