"""The axes of an array of images: rows and columns, a stack, and color channels."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import numpy.typing as npt

MAX_CHANNELS = 4
"""Largest length of an axis of colors."""

_MIN_SIDE = 16
"""Minimum length of the other two axes for a short axis to count as color channels."""


def looks_like_color(shape: tuple[int, ...]) -> bool:
    """Return whether a short last axis after two longer ones suggests color channels.

    Examples
    --------
    >>> looks_like_color((256, 256, 3)), looks_like_color((3, 256, 256))
    (True, False)
    """
    return len(shape) > 2 and shape[-1] <= MAX_CHANNELS < min(shape[-3:-1])


def is_single_image(shape: tuple[int, ...]) -> bool:
    """Return whether a shape is that of one image, (H, W) or (H, W, C) with at most 4 channels.

    Examples
    --------
    >>> is_single_image((480, 640, 3)), is_single_image((100, 480, 640))
    (True, False)
    """
    return len(shape) == 2 or (len(shape) == 3 and shape[2] <= MAX_CHANNELS)


def _likelier_axis(shape: tuple[int, ...], axis: int) -> int | None:
    """Return the first or the last axis if it looks like colors, but the other one is stated.

    Examples
    --------
    >>> _likelier_axis((3, 256, 256), -1), _likelier_axis((256, 256, 3), 0)
    (0, -1)
    >>> _likelier_axis((256, 256, 31), -1)
    """
    other = {0: -1, 2: 0}.get(axis % len(shape))
    if len(shape) != 3 or other is None or shape[other] > MAX_CHANNELS:
        return None
    return other if min(np.delete(shape, other)) >= _MIN_SIDE else None


@dataclasses.dataclass(frozen=True)
class Layout:
    """Which axes of an array are the rows and columns of its images.

    Without a channel axis they are the last two. With it, they are the last two others.

    Examples
    --------
    >>> layout = Layout.of("image", np.zeros((5, 8, 6, 3)), channel_axis=-1)
    >>> layout.shape
    (5, 3)
    >>> layout.split(np.zeros((5, 8, 6, 3))).shape
    (15, 8, 6)
    >>> layout.arrange(np.zeros((15, 4, 4))).shape
    (5, 4, 4, 3)
    """

    shape: tuple[int, ...] = ()
    """Lengths of the axes of a stack, followed by the number of channels if there is an axis of
    them."""
    channel_axis: int | None = None
    """The axis of channels, or None."""

    @classmethod
    def of(cls, name: str, array: npt.NDArray[Any], channel_axis: int | None) -> Self:
        """Return the layout of an array.

        Raises
        ------
        TypeError
            When the axis is not a whole number.
        ValueError
            When the array has too few axes, or no pixels, or looks like a color image although
            there is no channel axis.
        """
        axes = 2 if channel_axis is None else 3
        if array.ndim < axes or array.size == 0:
            expected = "(H, W) or (..., H, W)" if axes == 2 else "three axes or more, with channels"
            raise ValueError(
                f"{name}: expected shape {expected}, and at least one pixel, got {array.shape}"
            )
        if channel_axis is None:
            if looks_like_color(array.shape):
                raise ValueError(
                    f"{name}: expected a stack (..., H, W), but shape {array.shape} looks like "
                    "color; pass channel_axis=-1 if the last axis holds channels"
                )
            return cls(array.shape[:-2])
        if isinstance(channel_axis, bool) or not isinstance(channel_axis, int | np.integer):
            raise TypeError(
                f"channel_axis: expected a whole number, such as -1, got {channel_axis!r}"
            )
        axis = int(channel_axis)
        if not -array.ndim <= axis < array.ndim:
            raise ValueError(
                f"channel_axis: expected {-array.ndim} to {array.ndim - 1} for shape "
                f"{array.shape}, got {axis}"
            )
        if (other := _likelier_axis(array.shape, axis)) is not None:
            raise ValueError(
                f"{name}: expected channels on the axis {axis}, but shape {array.shape} looks like "
                f"channels on the axis {other}; pass channel_axis={other}"
            )
        return cls(np.moveaxis(array, axis, -3).shape[:-2], axis)

    @property
    def number(self) -> int:
        """The number of gray images."""
        return math.prod(self.shape)

    @property
    def is_stack(self) -> bool:
        """Whether there are axes of a stack."""
        return len(self.shape) > (self.channel_axis is not None)

    @property
    def is_single(self) -> bool:
        """Whether there is only one gray image (H, W), without further axes."""
        return not self.shape

    def shape_of(self, size: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of an array of this layout, for images of a size.

        Examples
        --------
        >>> Layout((5, 3), -1).shape_of((8, 6))
        (5, 8, 6, 3)
        """
        if self.channel_axis is None:
            return *self.shape, *size
        shape = [*self.shape[:-1], *size]
        shape.insert(self.channel_axis % (len(shape) + 1), self.shape[-1])
        return tuple(shape)

    def moved(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return a view of an array of this layout, with rows and columns as its last axes."""
        return array if self.channel_axis is None else np.moveaxis(array, self.channel_axis, -3)

    def split(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the gray images of an array of this layout, (N, H, W), as a view if possible."""
        array = self.moved(array)
        return array.reshape(self.number, *array.shape[-2:])

    def name_of(self, index: int) -> str:
        """Return how messages name a gray image.

        Examples
        --------
        >>> Layout((2, 3), -1).name_of(4)
        'image 1, channel 1'
        """
        *stack, last = map(int, np.unravel_index(index, self.shape))
        if self.channel_axis is None:
            return f"image {', '.join(map(str, [*stack, last]))}"
        return f"image {', '.join(map(str, stack))}, channel {last}" if stack else f"channel {last}"

    def arrange(self, images: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return gray images (N, H, W) as one array of this layout, in C order."""
        array = images.reshape(*self.shape, *images.shape[1:])
        if self.channel_axis is not None:
            array = np.ascontiguousarray(np.moveaxis(array, -3, self.channel_axis))
        return array


def image_channels(
    name: str, array: npt.NDArray[Any], channel_axis: int | None
) -> npt.NDArray[Any]:
    """Return the channels (C, H, W) of one image, which has one channel without a channel axis.

    Raises
    ------
    TypeError, ValueError
        For a stack of images, and as :meth:`Layout.of`.

    Examples
    --------
    >>> image_channels("image", np.zeros((8, 6, 3)), -1).shape
    (3, 8, 6)
    """
    layout = Layout.of(name, array, channel_axis)
    if layout.is_stack:
        raise ValueError(
            f"{name}: expected one image, got a stack of shape {array.shape}; pass each image alone"
        )
    return layout.split(array)


def join(parts: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Return parts of a stack as one. A single part is not copied.

    Examples
    --------
    >>> join([np.zeros((2, 8, 6)), np.zeros((1, 8, 6))]).shape
    (3, 8, 6)
    """
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
