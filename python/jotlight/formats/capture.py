"""What a reader of a format gives: frames of bits or of counts, and where they are from."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.description import read_counts_label
from jotlight.formats.orientation import orient_image, orient_packed, parse_orientation
from jotlight.sensing.bits import Bits, SensorLike
from jotlight.sensing.frames import Frames, format_frame_range, read_in_chunks
from jotlight.sensing.provenance import Provenance

Counts = npt.NDArray[np.int32]

_LOOKED_AT = 1 << 20
"""Bytes of frames that tell whether they are packed."""
_FEWEST = 8
"""Jots that fire in them, at least, for that to be told."""


@dataclasses.dataclass(frozen=True)
class CountStack:
    """Images of counts, of which the sum is what methods take."""

    images: npt.NDArray[Any] | Frames
    """(T, H, W) or (T, H, W, C), whole numbers."""
    provenance: Provenance
    trials: int | None = None
    """Number of binary readings behind each count of one image, if the file states it."""

    @property
    def total_trials(self) -> int | None:
        """Number of binary readings behind each count of the sum, or None if it is unknown."""
        return None if self.trials is None else self.trials * len(self.images)

    def sum(self, progress: Callable[[float], object] | None = None) -> Counts:
        """The sum of all images, (H, W) or (H, W, C), in memory of a few images."""
        total = np.zeros(self.images.shape[1:], np.int64)
        for place, part in read_in_chunks(self.images):
            if part.min() < 0 or part.max() >= 2**31:
                raise ValueError(
                    f"{self.provenance.name}: expected counts from 0 to 2**31 - 1, got "
                    f"{part.min()} to {part.max()}"
                )
            if self.trials is not None and part.max() > self.trials:
                raise ValueError(
                    f"{self.provenance.name}: its label tells of counts out of {self.trials}, and it "
                    f"has {part.max()}"
                )
            total += part.sum(axis=0, dtype=np.int64)
            if progress:
                progress(place.stop / len(self.images))
        if total.max() >= 2**31:
            raise ValueError(f"{self.provenance.name}: the sum of its counts is 2**31 or more")
        if total.any() and not (total % 255).any():
            warn(
                f"{self.provenance.name}: all of its counts are multiples of 255, as in a picture of "
                "black and white, where a count of 1 is meant"
            )
        return total.astype(np.int32)


Capture = Bits | CountStack


def is_single_image(shape: tuple[int, ...]) -> bool:
    """Whether this is the shape of one image, (H, W) or in colour (H, W, C), and not of a stack."""
    return len(shape) == 2 or (len(shape) == 3 and shape[2] <= 4)


def as_count_stack(
    images: npt.NDArray[Any] | Frames, provenance: Provenance, label: str | None = None
) -> CountStack:
    """Images of counts as a stack, or raise ValueError when their shape or type does not fit.

    A label that jotlight wrote tells out of how many bits they are.
    Three dimensions of which the last is at most 4 are one image in colour.
    """
    shape = images.shape
    if images.dtype.kind not in "iub" or len(shape) not in (2, 3, 4) or images.size == 0:
        raise ValueError(
            f"expected counts in whole numbers, (H, W), (T, H, W), (H, W, C) or "
            f"(T, H, W, C), none of it 0, got {images.dtype} of shape {shape}"
        )
    if len(shape) == 4 and shape[3] > 4:
        raise ValueError(f"expected at most 4 channels, got shape {shape}")
    frames, origin = read_counts_label(label)
    provenance = provenance.converted_from(origin)
    if frames is not None:
        provenance = provenance.with_notes(f"counts out of {frames}, as the file tells")
    if is_single_image(shape):
        images = np.asarray(images)[None]
    return CountStack(images, provenance, frames)


def pack_lazily(frames: npt.NDArray[Any] | Frames, name: str) -> Frames:
    """Unpacked frames (T, H, W) or (T, H, W, C) of 0 and 1, or 255, packed as they are read."""
    count, height, width, *channels = frames.shape

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        out = np.empty((stop - start, height, (width + 7) // 8, *channels), np.uint8)
        for place, part in read_in_chunks(frames[start:stop]):
            bits = np.isin(part, (0, 1)).all() or np.isin(part, (0, 255)).all()
            if part.dtype != np.bool_ and not bits:
                raise ValueError(
                    f"{name}: expected bits, 0 and 1 only, got {part.min()} to {part.max()}; "
                    "counts=True (--counts) takes the numbers for counts"
                )
            out[place] = np.packbits(part.astype(np.bool_), axis=2)
        return out

    return Frames((count, height, (width + 7) // 8, *channels), read)


def pack_stack(stack: CountStack) -> Bits:
    """Images of which each number is one bit, as bits."""
    images, provenance = stack.images, stack.provenance
    packed = pack_lazily(images, provenance.name)
    return Bits(packed, images.shape[2], provenance=provenance.with_notes("one bit in each number"))


def check_packed(frames: npt.NDArray[np.uint8] | Frames, name: str) -> None:
    """Raise ValueError when the first frames look as if each byte were one bit.

    Then there is nothing but 0 and 1, or 0 and 255, though many jots fire. Where too few do, those
    in the middle and the last are looked at too.
    """
    each = max(1, frames.nbytes // max(1, len(frames)))
    number = max(1, _LOOKED_AT // each)
    fired, levels = np.zeros(frames.shape[1:], np.bool_), {0}
    for start in (0, max(0, len(frames) - number) // 2, max(0, len(frames) - number)):
        part = np.asarray(frames[start : start + number, ...])
        fired |= part.any(axis=0)
        levels |= set(np.unique(part).tolist())
        if part.all() or levels not in ({0}, {0, 1}, {0, 255}):
            return
        if fired.sum() >= _FEWEST:
            raise ValueError(
                f"{name}: its frames hold nothing but 0 and {max(levels)}, as far as was looked, "
                "as frames do that are not packed; give unpacked=True (--unpacked) for one bit in "
                "each byte, or unpacked=False (--packed) for eight"
            )


def select(
    capture: Capture,
    frames: slice | None,
    rotate: int,
    flip: str | None,
    key: str | None = None,
) -> Capture:
    """Some of a capture's frames, turned and mirrored; `key` is noted."""
    quarters = parse_orientation(rotate, flip)
    notes = [f"the array {key}"] if key is not None else []
    if quarters:
        notes.append(f"rotated by {90 * quarters} degrees anticlockwise")
    if flip is not None:
        notes.append(f"mirrored, {flip}")

    def told(provenance: Provenance) -> Provenance:
        return provenance.with_notes(*notes).reoriented(quarters, flip)

    if isinstance(capture, CountStack):
        images, provenance = capture.images, capture.provenance
        if len(images) > 1:
            provenance = provenance.with_notes(
                f"the sum of a stack of {len(images)} images of counts"
            )
        provenance = told(provenance)
        if frames is not None:
            images = images[frames]
            if len(images) == 0:
                raise ValueError(
                    f"frames: no frames in {format_frame_range(frames)} of {len(capture.images)}"
                )
            provenance = provenance.with_notes(
                f"of the stack {len(images)} of {len(capture.images)}"
            )
        return CountStack(_turned_images(images, quarters, flip), provenance, capture.trials)
    if frames is not None:
        capture = capture[frames]
    if not notes:
        return capture
    packed, width = orient_packed(capture.packed, capture.width, quarters, flip)
    sensor = capture.sensor and _turned_sensor(capture.sensor, quarters, flip)
    return Bits(packed, width, sensor, capture.provenance and told(capture.provenance))


def _turned_images(
    images: npt.NDArray[Any] | Frames, quarters: int, flip: str | None
) -> npt.NDArray[Any] | Frames:
    if quarters == 0 and flip is None:
        return images
    frames, height, width, *channels = images.shape
    shape = (frames, *((width, height) if quarters % 2 else (height, width)), *channels)

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        part = images[start:stop]
        whole = part.read(0, len(part)) if isinstance(part, Frames) else part
        return np.stack([orient_image(image, quarters, flip) for image in whole])

    return Frames(shape, read, images.dtype)


def _turned_sensor(sensor: SensorLike, quarters: int, flip: str | None) -> SensorLike:
    maps = {name: orient_image(map_, quarters, flip) for name, map_ in sensor.maps().items()}
    return sensor.replace(**maps)
