"""Numbers and maps as the engine expects them."""

from typing import Any

import numpy as np


def flatten(value: Any) -> Any:
    """Return a map as a flat array, without a copy if it is contiguous. Return a number unchanged.

    Examples
    --------
    >>> flatten(np.arange(4).reshape(2, 2)), flatten(0.5)
    (array([0, 1, 2, 3]), 0.5)
    """
    return value.reshape(-1) if isinstance(value, np.ndarray) else value
