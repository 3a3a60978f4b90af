"""Detection of bytes that each hold one number, where eight packed bits are expected."""

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits.frames import Frames, frames_within

_INSPECTED_BYTES = 1 << 20
"""Number of bytes that are read at each of three positions."""

_FEW_ROWS = 8
"""Number of rows that usually show that an array holds packed bits."""

_MIN_NONZERO = 8
"""Minimum number of bytes above 0 at which frames can be recognized as unpacked."""

_HIGHEST_BIT = 128
"""Value of the highest bit of a byte: the first of eight jots."""

_MIN_COUNTS = 256
"""Minimum number of bytes above 0 at which counts can be recognized.

If eight jots see the same light, the highest bit of such a byte is set with a probability of 1/8 or
more, so that all of them miss it with a probability below 1e-14.
"""

WHITE = 1, 255
"""Bytes that stand for one bit, beside 0."""


def largest_number(frames: npt.NDArray[np.uint8] | Frames) -> int | None:
    """Return the largest byte if each looks like one bit or a count, and None otherwise.

    Unpacked frames hold only 0 and 1, or only 0 and 255, although many bytes are above 0. Counts
    below 128 never set the highest bit. The function reads the first frames. If few bytes are above
    0 there, it also reads frames from the middle and from the end.

    Examples
    --------
    >>> bits = np.eye(16, dtype=np.uint8)[None]
    >>> largest_number(bits), largest_number(np.packbits(bits, axis=2))
    (1, None)
    """
    if frames.size == 0:
        # A file without frames can claim frames of any size, so no memory is allocated for one.
        return None
    number = frames_within(frames, _INSPECTED_BYTES)
    nonzero, levels = np.zeros(frames.shape[1:], np.bool_), {0}
    for start in (0, max(0, len(frames) - number) // 2, max(0, len(frames) - number)):
        part = np.asarray(frames[start : start + number, ...])
        nonzero |= part.any(axis=0)
        levels |= set(np.unique(part).tolist())
        highest = max(levels)
        if 1 < highest < _HIGHEST_BIT and np.count_nonzero(part) >= _MIN_COUNTS:
            return highest
        if part.all() or levels not in ({0}, *({0, white} for white in WHITE)):
            return None
        if nonzero.sum() >= _MIN_NONZERO:
            return highest
    return None


def refuse_numbers(packed: npt.NDArray[np.uint8]) -> None:
    """Raise ValueError if each byte of an array in place of packed bits looks like one number.

    Examples
    --------
    >>> refuse_numbers(np.eye(16, dtype=np.uint8)[None])
    Traceback (most recent call last):
      ...
    ValueError: packed: expected eight bits to a byte, but the inspected bytes are only 0 and 1, ...
    """
    few = packed[0, :_FEW_ROWS]
    if few.max() >= _HIGHEST_BIT and not np.isin(few, (0, *WHITE)).all():
        return  # most packed bits are recognized here, in microseconds
    highest = largest_number(packed)
    if highest is None:
        return
    looks, advice = f"at most {highest}, as in images of counts", "methods take counts as they are"
    if highest in WHITE:
        packing = "array" if highest == 1 else f"array == {highest}"
        looks = f"only 0 and {highest}, as in unpacked frames"
        advice = f"jotlight.Bits.from_array({packing}) packs one bit in each byte"
    raise ValueError(
        f"packed: expected eight bits to a byte, but the inspected bytes are {looks}; {advice}, "
        f"and width={8 * packed.shape[2]} states that these are packed bits"
    )
