"""The results of reading a file: frames of bits, or images of counts."""

import dataclasses
from collections.abc import Iterator
from typing import Any, Self, SupportsIndex, overload

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts
from jotlight.errors import counted, warn
from jotlight.notebook import card, normalize
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.crop import OneFrame, Region, crop_frames, split_index
from jotlight.sensing.bits.frames import Frames, frame_index, read_in_chunks
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.scaled_counts import scaled_counts_hint
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.slices import refuse_no_frames
from jotlight.sensing.sensor import Sensor

_MAX_COUNT = 2**31 - 1
"""Largest count of an image, and of the sum of all."""


@dataclasses.dataclass(frozen=True, eq=False)
class CountStack:
    """Images of counts. Reconstruction uses their sum.

    Examples
    --------
    >>> stack = CountStack(np.ones((5, 2, 2), np.uint8), Provenance("npy", "a.npy"), trials=10)
    >>> stack.sum().tolist(), stack.total_trials
    ([[5, 5], [5, 5]], 50)
    >>> len(stack[1:3]), stack[0].shape
    (2, (2, 2))
    """

    images: npt.NDArray[Any] | Frames
    """Integers, (T, H, W) or (T, H, W, C), or floats that :func:`unscale` turns into integers."""
    provenance: Provenance
    trials: int | None = None
    """Number of binary readings behind each count of one image, if the file states it."""
    sensor: Sensor | None = None
    """The sensor of readings of several bits, if the file states that the images are frames of
    such readings."""

    @property
    def total_trials(self) -> int | None:
        """Number of binary readings behind each count of the sum, or None if it is unknown."""
        return None if self.trials is None else self.trials * len(self.images)

    @property
    def sum_provenance(self) -> Provenance:
        """Provenance of the sum of the images, which says how many were added."""
        if len(self) == 1:
            return self.provenance
        return self.provenance.with_notes(f"the sum of a stack of {len(self)} images of counts")

    def with_trials_of(self, sensor: Sensor) -> Self:
        """Return the stack with the trials of each image that a sensor of all images states.

        Raises
        ------
        ValueError
            When the frames of the sensor are no multiple of the images, or the images state other
            trials.

        Examples
        --------
        >>> stack = CountStack(np.ones((5, 2, 2), np.uint8), Provenance("npy", "a.npy"))
        >>> stack.with_trials_of(jl.Sensor(frames=50)).trials
        10
        """
        number, frames = len(self), sensor.frames
        if frames % number:
            raise ValueError(
                f"frames: expected a multiple of the {number} images of counts, because the sensor "
                f"states the frames of all of them together, got {frames}; if each image has "
                f"{frames} frames, pass frames={number * frames} (--frames {number * frames})"
            )
        if self.total_trials not in (None, sensor.trials):
            expected = self.total_trials // sensor.oversampling**2
            raise ValueError(
                f"sensor: expected {expected} frames, as many as the counts have binary readings, "
                f"got {frames}; take sensor.replace(frames={expected}) (--frames {expected})"
            )
        return dataclasses.replace(self, trials=sensor.trials // number)

    def check_bit_depth(self, stated: int) -> None:
        """Raise ValueError when a number of bits per reading contradicts what the file states."""
        if self.sensor is not None and stated != self.sensor.bit_depth:
            found, expected = f"readings of {self.sensor.bit_depth} bits", str(stated)
        elif self.trials is not None:
            found, expected = f"counts out of {self.trials}", f"readings of {stated} bits"
        else:
            return
        raise ValueError(
            f"bit_depth: {self.provenance.name} states {found}, not {expected}; leave out "
            "bit_depth= (--bit-depth)"
        )

    def check_range(self, images: npt.NDArray[Any]) -> None:
        """Raise ValueError when some of the images hold numbers that are no counts of the trials.

        Examples
        --------
        >>> images = np.full((1, 3, 3), 4)
        >>> CountStack(images, Provenance("npy", "a.npy"), trials=3).check_range(images)
        Traceback (most recent call last):
          ...
        ValueError: a.npy: expected counts from 0 to 3, the trials of each image, got 4 to 4
        """
        low, high = images.min(), images.max()
        limit = _MAX_COUNT if self.trials is None else min(self.trials, _MAX_COUNT)
        if low >= 0 and high <= limit:
            return
        advice = scaled_counts_hint(images.astype(np.int64))
        if advice is None and low >= 0 and len(self) > 1 and self.trials is not None:
            advice = "frames= (--frames) states the frames of all images together"
        raise ValueError(
            f"{self.provenance.name}: expected counts from 0 to {limit}"
            f"{'' if self.trials is None else ', the trials of each image'}, got {low} to {high}"
            + (f"; {advice}" if advice else "")
        )

    def __len__(self) -> int:
        """Return the number of images."""
        return len(self.images)

    @overload
    def __getitem__(self, index: slice | tuple[slice, ...]) -> Self: ...
    @overload
    def __getitem__(self, index: SupportsIndex | OneFrame) -> npt.NDArray[Any]: ...
    def __getitem__(self, index: Any) -> Self | npt.NDArray[Any]:
        """Return an image, (H, W) or (H, W, C), or a stack of a slice of the images.

        ``counts[:, 10:40, 16:48]`` has some rows and columns. A slice reads nothing.
        """
        frames, parts = split_index(index)
        if not isinstance(frames, slice):
            place = frame_index("counts", frames, len(self))
            part: Any = self[(slice(place, place + 1), *parts)].images
            image: npt.NDArray[Any] = np.asarray(part)[0]
            return image
        refuse_no_frames("counts", frames, len(self))
        region = Region.of("counts", parts, self.images.shape, self.sensor)
        images, sensor = self.images[frames], self.sensor and self.sensor.select_frames(frames)
        if region is None:
            return dataclasses.replace(self, images=images, sensor=sensor)
        images, sensor = crop_frames(images, region), sensor and region.crop_sensor(sensor)
        provenance = self.provenance.with_notes(region.describe(self.images.shape))
        return dataclasses.replace(self, images=images, sensor=sensor, provenance=provenance)

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        """Yield each image."""
        for _, part in read_in_chunks(self.images):
            yield from part

    def readings(self, sensor: Sensor | None = None) -> Readings:
        """Return the images as frames of readings of several bits.

        Parameters
        ----------
        sensor : Sensor, optional
            Their sensor. Default: the one that the file states.

        Raises
        ------
        ValueError
            When the file states no sensor, or the images do not fit it.
        """
        stated = sensor or self.sensor
        if stated is None:
            raise ValueError(
                f"{self.provenance.name}: does not state that it holds readings of several bits; "
                "pass bit_depth= (--bit-depth)"
            )
        try:
            return Readings(self.images, stated, self.provenance)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{self.provenance.name}: {error}") from error

    def sum(self, progress: Progress = False) -> Counts:
        """Return the sum of all images, (H, W) or (H, W, C), in the memory of a few images.

        Parameters
        ----------
        progress : bool or callable, optional
            Whether to show a progress bar, or a function that is called repeatedly with the
            completed fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

        Raises
        ------
        ValueError
            When a count is negative or above the number of trials, or the sum exceeds int32.
        """
        name = self.provenance.name
        total, bound = np.zeros(self.images.shape[1:], np.uint32), 0
        with shown_progress(progress, "adding counts") as update:
            for place, part in read_in_chunks(self.images):
                self.check_range(part)
                high = int(part.max())
                for image in part:
                    # Neither of two values below 2**31 nor their sum exceeds the type.
                    np.add(total, image, out=total, dtype=np.uint32, casting="unsafe")
                    bound += high
                    if bound > _MAX_COUNT < total.max():
                        raise ValueError(f"{name}: the sum of its counts is 2**31 or more")
                update(place.stop / len(self.images))
        if total.any() and not any((row % 255).any() for row in total):
            warn(
                f"{name}: all of its counts are multiples of 255, as in a black-and-white image "
                "where 255 stands for a count of 1; unpacked=True (--unpacked) reads the bits of "
                "such an image"
            )
        return total.view(np.int32)

    def _facts(self) -> dict[str, str]:
        shape = " x ".join(map(str, self.images.shape[1:]))
        trials = "unknown" if self.trials is None else str(self.trials)
        return {"images": str(len(self)), "size": shape, "trials of each": trials}

    def _repr_html_(self) -> str:
        facts = {**self._facts(), "file": self.provenance, "image": "the first one"}
        return card("CountStack", facts, normalize(self[0]))

    def __repr__(self) -> str:
        _, size, trials = self._facts().values()
        number = counted(len(self), "image")
        return f"<CountStack: {number} of {size} counts, trials of each: {trials}>"


Capture = Bits | CountStack
"""The content of a capture file."""


def assumed_sensor_note(sensor: Sensor) -> str:
    """Return the note about the sensor that bits are taken to have, because they do not state it.

    Examples
    --------
    >>> assumed_sensor_note(jl.Sensor(frames=4))
    'the bits do not state their sensor; assumed: Sensor(frames=4)'
    """
    return f"the bits do not state their sensor; assumed: {sensor!r}"


def frames_of(capture: Capture) -> npt.NDArray[Any] | Frames:
    """Return the packed frames of bits, or the images of counts.

    Examples
    --------
    >>> frames_of(jl.Bits(np.zeros((3, 4, 1), np.uint8))).shape
    (3, 4, 1)
    """
    return capture.packed if isinstance(capture, Bits) else capture.images


def with_frames(capture: Capture, frames: npt.NDArray[Any] | Frames) -> Capture:
    """Return the same capture with other frames of the same shape, such as a copy of its own.

    Examples
    --------
    >>> bits = jl.Bits(np.zeros((3, 4, 1), np.uint8))
    >>> with_frames(bits, np.ones((3, 4, 1), np.uint8)).packed.sum()
    np.uint64(12)
    """
    if isinstance(capture, CountStack):
        return dataclasses.replace(capture, images=frames)
    return capture.replace(packed=frames)


def jot_shape(data: Bits | CountStack) -> tuple[int, ...]:
    """Return (T, H, W) or (T, H, W, C) of bits, or of images of counts.

    Examples
    --------
    >>> jot_shape(jl.Bits.from_array(np.zeros((5, 2, 3), bool)))
    (5, 2, 3)
    """
    return tuple(data.shape if isinstance(data, Bits) else data.images.shape)
