"""Sums over each image of a stack of arrays, (N, ...).

The sum of an image does not depend on the other images of its stack.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array


def dots(a: Array, b: Array) -> Array:
    """Return ⟨a, b⟩ of each image of two stacks of float64, (N,).

    The threads of BLAS would compete with the engine's, and a sum of ``numpy.einsum`` depends on
    the other images.

    Examples
    --------
    >>> dots(np.array([[1.0, 2.0], [3.0, 0.0]]), np.ones((2, 2))).tolist()
    [3.0, 3.0]
    """
    rows = (len(a), -1)
    return np.array(
        engine.inner_products(
            np.ascontiguousarray(a).reshape(rows), np.ascontiguousarray(b).reshape(rows)
        )
    )


def image_sums(stack: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the sum over each image of a stack, (N,).

    Examples
    --------
    >>> image_sums(np.ones((2, 3, 4))).tolist()
    [12.0, 12.0]
    """
    sums: npt.NDArray[Any] = stack.reshape(len(stack), -1).sum(axis=1)
    return sums


def image_means(stack: Array) -> Array:
    """Return the mean of each image of a stack, (N,).

    Examples
    --------
    >>> image_means(np.array([[1.0, 3.0]])).tolist()
    [2.0]
    """
    return np.asarray(image_sums(stack) / stack[0].size)


def each_image(values: npt.NDArray[Any], stack: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the numbers of the images, (N,), as an array that broadcasts with their stack.

    Examples
    --------
    >>> each_image(np.array([1.0, 2.0]), np.ones((2, 3))).tolist()
    [[1.0], [2.0]]
    """
    return values.reshape(-1, *[1] * (stack.ndim - 1))


def are_all(images: npt.NDArray[np.bool_]) -> bool:
    """Return whether a mask (N,) marks all images.

    Examples
    --------
    >>> are_all(np.array([True, False]))
    False
    """
    # A list of few values takes less time than an array.
    return all(images.tolist())


def select(stack: npt.NDArray[Any], images: npt.NDArray[np.bool_]) -> npt.NDArray[Any]:
    """Return the images of a mask (N,). The stack itself, if they are all.

    Examples
    --------
    >>> select(np.array([[1.0], [2.0]]), np.array([False, True])).tolist()
    [[2.0]]
    """
    return stack if are_all(images) else stack[images]


def replace(
    stack: npt.NDArray[Any], images: npt.NDArray[np.bool_], values: npt.NDArray[Any]
) -> npt.NDArray[Any]:
    """Return the stack with other values for the images of a mask (N,). It may be overwritten.

    Examples
    --------
    >>> replace(np.zeros((2, 1)), np.array([False, True]), np.ones((1, 1))).tolist()
    [[0.0], [1.0]]
    """
    if are_all(images):
        return values
    stack[images] = values
    return stack
