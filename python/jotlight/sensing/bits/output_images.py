"""The argument `out` of methods: an array of the caller for the images that they return."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import refuse_masked
from jotlight.layout import Layout


def check_out(out: object, shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return `out`, an array for a result, after checking its type and its shape.

    Raises
    ------
    TypeError
        When it is not an array.
    ValueError
        When it has another data type or another shape, or is read-only. Nothing is cast.

    Examples
    --------
    >>> check_out(np.zeros((2, 3)), (2, 3), np.float32)
    Traceback (most recent call last):
      ...
    ValueError: out: expected a writeable array of float32 of shape (2, 3), got float64 of shape \
(2, 3); numpy.empty((2, 3), numpy.float32) is such an array
    """
    name = np.dtype(dtype).name
    expected = f"a writeable array of {name} of shape {shape}"
    advice = f"numpy.empty({shape}, numpy.{name}) is such an array"
    if not isinstance(out, np.ndarray):
        raise TypeError(f"out: expected {expected}, got {type(out).__name__}; {advice}")
    refuse_masked("out", out)
    if out.dtype != dtype or out.shape != shape or not out.flags.writeable:
        read_only = "" if out.flags.writeable else "read-only "
        raise ValueError(
            f"out: expected {expected}, got {read_only}{out.dtype} of shape {out.shape}; {advice}"
        )
    return out


class OutputImages:
    """The gray images (N, H, W) of float32 that a method computes, in the caller's or a new array.

    Parameters
    ----------
    layout : Layout
        How the images form the array that is returned.
    size : tuple of int
        Height and width of an image.
    out : ndarray, optional
        The array of the caller. It may have any strides.
    inputs : iterable of ndarray
        Arrays that the method reads while it writes. They may overlap `out`.

    Raises
    ------
    TypeError, ValueError
        When `out` cannot hold the result (:func:`check_out`).

    Examples
    --------
    >>> out = np.zeros((4, 5, 3), np.float32)
    >>> output = OutputImages(Layout((3,), -1), (4, 5), out)
    >>> output.images[:] = [[[0.0]], [[1.0]], [[2.0]]]
    >>> output.finish(output.images) is out, out[0, 0].tolist()
    (True, [0.0, 1.0, 2.0])
    """

    def __init__(
        self,
        layout: Layout,
        size: tuple[int, ...],
        out: object = None,
        inputs: Iterable[npt.NDArray[Any]] = (),
    ) -> None:
        self._layout = layout
        self._shape = layout.number, *size
        self._out = None if out is None else check_out(out, layout.shape_of(size), np.float32)
        self._inputs = inputs
        self._images: npt.NDArray[Any] | None = None

    @property
    def images(self) -> npt.NDArray[Any]:
        """Images in C order to be written, (N, H, W): those of `out`, if these are in C order."""
        if self._images is None:
            own = None if self._out is None else self._layout.moved(self._out).reshape(self._shape)
            if own is None or not self._can_write(own):
                own = np.empty(self._shape, np.float32)
            self._images = own
        return self._images

    def _can_write(self, own: npt.NDArray[Any]) -> bool:
        """Return whether an array consists of the memory of `out`, and the engine can write it."""
        assert self._out is not None
        is_view = np.may_share_memory(own, self._out)
        is_read = any(np.may_share_memory(own, each) for each in self._inputs)
        return is_view and own.flags.c_contiguous and own.flags.aligned and not is_read

    def deliver(self, array: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return a result in the layout: itself, or `out` with its values."""
        if self._out is None:
            return array
        self._out[...] = array
        return self._out

    def finish(self, images: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return images (N, H, W) in the layout: `out` itself, or an array in C order."""
        if self._out is None:
            return self._layout.arrange(images)
        target = self._layout.moved(self._out)
        if images is not self._images or not np.may_share_memory(images, target):
            target[...] = images.reshape(target.shape)
        return self._out
