"""The values of pixels, chosen by their labels."""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Number = TypeVar("Number", bound=np.number[Any])


def choose(
    labels: npt.NDArray[np.uint8] | npt.NDArray[np.intp], fields: Sequence[npt.NDArray[Number]]
) -> npt.NDArray[Number]:
    """Return for each pixel the value in the field whose index is its label.

    `numpy.choose` takes at most 32 or 64 fields.

    Parameters
    ----------
    labels : ndarray of integers, shape (H, W)
        Labels from 0 to the number of fields - 1.
    fields : sequence of ndarray, shape (..., H, W)
        The fields.

    Examples
    --------
    >>> choose(np.array([[0, 1, 0]]), [np.array([[1, 2, 3]]), np.array([[7, 8, 9]])])
    array([[1, 8, 3]])
    """
    first, *others = fields
    if not others:
        return first
    chosen = first.copy()
    for label, field in enumerate(others, 1):
        np.copyto(chosen, field, where=labels == label)
    return chosen
