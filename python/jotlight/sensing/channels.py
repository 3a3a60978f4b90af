"""Colour: every method works on one channel, and this runs it on each."""

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits import Bits
from jotlight.sensing.pixel_counts import as_counts

Picture = npt.NDArray[np.float32]


def channels_of(data: Bits | npt.ArrayLike) -> Iterator[Bits | npt.NDArray[np.int32]]:
    """Give (T, H, W) bits or (H, W) counts of each channel of `data`, of grey the data."""
    if isinstance(data, Bits):
        if len(data.shape) == 3:
            yield data
            return
        for c in range(data.shape[3]):
            yield Bits(data.packed[..., c], data.width, data.sensor)
        return
    counts = as_counts(data)
    if counts.ndim == 2:
        yield counts
        return
    for c in range(counts.shape[2]):
        yield np.ascontiguousarray(counts[..., c])


def by_channel(
    method: Callable[[Bits | npt.NDArray[np.int32]], Picture], data: Bits | npt.ArrayLike
) -> Picture:
    """Run a method of one channel on each channel of `data`."""
    pictures = [method(channel) for channel in channels_of(data)]
    dimensions = len(data.shape) - 1 if isinstance(data, Bits) else np.ndim(data)
    return pictures[0] if dimensions == 2 else np.stack(pictures, axis=-1)
