"""Linear functions of arrays, with checks of their shapes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from operator import index

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import refuse_data, refuse_masked, shown
from jotlight.sensing.bits.values import as_doubles

LinearMap = Callable[[Array], Array]
"""A linear function of an array."""


@dataclasses.dataclass(frozen=True)
class CheckedMap:
    """A function that checks the shape of its output, and may take each array of a stack."""

    name: str
    function: LinearMap
    dimensions: int | None
    shape: tuple[int, ...]

    def __call__(self, array: Array) -> Array:
        """Return the output for an array, or for each array of a stack."""
        is_stack = self.dimensions is not None and np.ndim(array) == self.dimensions + 1
        output = np.stack([*map(self.function, array)]) if is_stack else self.function(array)
        return array_of_shape(f"the output of {self.name}", output, self.shape)


def checked_shape(shape: Sequence[int]) -> tuple[int, ...]:
    """Return the shape of an image or a signal.

    Raises
    ------
    TypeError, ValueError
        For anything else.

    Examples
    --------
    >>> checked_shape([4, 6])
    (4, 6)
    """
    try:
        sizes = tuple(index(size) for size in shape)
    except TypeError:
        raise TypeError(
            f"shape: expected (H, W) or (N,) in whole numbers, got {shown(shape)}; pass image.shape"
        ) from None
    if len(sizes) not in (1, 2) or min(sizes) < 1:
        raise ValueError(f"shape: expected (H, W) or (N,), without a dimension of 0, got {sizes}")
    return sizes


def array_of_shape(name: str, array: npt.ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return an array of the given shape, or a stack with one more axis, in C order."""
    refuse_masked(name, array)
    refuse_data(name, array)
    values = as_doubles(array)
    if shape not in (values.shape, values.shape[1:]):
        raise ValueError(f"{name}: expected shape {shape}, got {values.shape}")
    return values
