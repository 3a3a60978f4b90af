"""Packing of frames that store one bit per number, and detection of such frames."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.formats.capture import CountStack
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import refuse_many_channels
from jotlight.sensing.bits.byte_levels import WHITE, largest_number
from jotlight.sensing.bits.frames import Frames, read_in_chunks


def pack_lazily(frames: npt.NDArray[Any] | Frames, name: str) -> Frames:
    """Return packed frames of unpacked ones. They are packed when they are read.

    Parameters
    ----------
    frames : ndarray or Frames, shape (T, H, W) or (T, H, W, C)
        Booleans, or numbers that are all 0 and 1, or all 0 and 255. Reading other numbers raises
        ValueError.
    name : str
        The file, for messages.

    Returns
    -------
    Frames of uint8, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)

    Examples
    --------
    >>> pack_lazily(np.eye(3, dtype=np.uint8)[None] * 255, "a.npy").read(0, 1).tolist()
    [[[128], [64], [32]]]
    """
    refuse_many_channels(name, frames.shape)
    count, height, width, *channels = frames.shape

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        packed = np.empty((stop - start, height, (width + 7) // 8, *channels), np.uint8)
        for place, part in read_in_chunks(frames[start:stop]):
            if not are_bits(part):
                raise ValueError(
                    f"{name}: expected bits, 0 and 1 only, got {part.min()} to {part.max()}; "
                    "counts=True (--counts) reads the numbers as counts"
                )
            packed[place] = np.packbits(part.astype(np.bool_), axis=2)
        return packed

    return Frames((count, height, (width + 7) // 8, *channels), read)


def are_bits(numbers: npt.NDArray[Any]) -> bool:
    """Return whether numbers are all 0 and 1, or all 0 and 255.

    Examples
    --------
    >>> are_bits(np.array([0, 255])), are_bits(np.array([1, 255])), are_bits(np.array([0, 2]))
    (True, False, False)
    """
    return numbers.dtype == np.bool_ or any(np.isin(numbers, (0, one)).all() for one in (1, 255))


def pack_stack(stack: CountStack) -> Bits:
    """Return the bits of a stack of images in which each number is one bit."""
    images, provenance = stack.images, stack.provenance
    packed = pack_lazily(images, provenance.name)
    provenance = provenance.with_notes("one bit in each number")
    return Bits(packed, images.shape[2], provenance=provenance)


def check_packed(frames: npt.NDArray[np.uint8] | Frames, name: str) -> None:
    """Raise ValueError when frames look as if each byte were one bit, or a count."""
    highest = largest_number(frames)
    if highest in WHITE:
        raise ValueError(
            f"{name}: the inspected frames hold nothing but 0 and {highest}, as unpacked "
            "frames do; pass unpacked=True (--unpacked) for one bit in each byte, or "
            "unpacked=False (--packed) for eight"
        )
    if highest is not None:
        raise ValueError(
            f"{name}: the inspected bytes are at most {highest}, as in images of counts; "
            "pass counts=True (--counts) for counts, or unpacked=False (--packed) for frames "
            "of packed bits"
        )
