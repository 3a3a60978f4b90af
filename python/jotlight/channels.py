"""Colour: every method works on one channel, and this runs it on each."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.bits import Bits
from jotlight.observation import as_counts

Picture = npt.NDArray[np.float32]


def by_channel(
    method: Callable[[Bits | npt.NDArray[np.int32]], Picture], data: Bits | npt.ArrayLike
) -> Picture:
    """Run a method of one channel, (T, H, W) bits or (H, W) counts, on each channel of `data`."""
    if isinstance(data, Bits):
        if len(data.shape) == 3:
            return method(data)
        channels = [
            Bits(data.packed[..., c], data.width, data.sensor) for c in range(data.shape[3])
        ]
        return np.stack([method(channel) for channel in channels], axis=-1)
    counts = as_counts(data)
    if counts.ndim == 2:
        return method(counts)
    return np.stack(
        [method(np.ascontiguousarray(counts[..., c])) for c in range(counts.shape[2])], axis=-1
    )
