"""Splitting of color arrays into channels, and stacking of channels into color arrays."""

from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt


class _Stack(Protocol):
    """An array, or frames in files."""

    @property
    def ndim(self) -> int: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    def __getitem__(self, key: Any, /) -> Any: ...


S = TypeVar("S", bound=_Stack)
Scalar = TypeVar("Scalar", bound=np.generic)


def channel_views(array: S, dimensions: int = 2) -> list[S]:
    """Return views of the channels of an array. A gray array is itself the only channel.

    Parameters
    ----------
    array : ndarray or Frames
        An array of `dimensions` dimensions. A color array has the channels as one more, the last.
    dimensions : int
        The number of dimensions without channels: 2 for images (H, W), 3 for frames (T, H, W).

    Examples
    --------
    >>> [channel.shape for channel in channel_views(np.zeros((4, 6, 3)))]
    [(4, 6), (4, 6), (4, 6)]
    """
    if array.ndim == dimensions:
        return [array]
    return [array[..., channel] for channel in range(array.shape[-1])]


def last_channel_axis(data: object) -> int | None:
    """Return the axis of channels of an image or counts of a file: the last of three, or None.

    Bits and merged counts know their channels, so the result is None for them.

    Examples
    --------
    >>> last_channel_axis(np.zeros((4, 6))), last_channel_axis(np.zeros((4, 6, 3)))
    (None, -1)
    """
    return -1 if isinstance(data, np.ndarray) and data.ndim == 3 else None


def stack_channels(images: Sequence[npt.NDArray[Scalar]], *, color: bool) -> npt.NDArray[Scalar]:
    """Return the channels of a color image stacked along the last axis, or the only gray image.

    Examples
    --------
    >>> stack_channels([np.zeros((4, 6))] * 3, color=True).shape
    (4, 6, 3)
    """
    return np.stack(images, axis=-1) if color else images[0]
