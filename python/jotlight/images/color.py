"""The type of images, and the conversion of color to gray."""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatImage = npt.NDArray[np.floating[Any]]
"""An image (H, W) or (H, W, 3) of floats, in any precision."""


def luma(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the gray of a color image (H, W, 3): 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601).

    Examples
    --------
    >>> luma(np.ones((2, 3, 3))).shape
    (2, 3)
    """
    return np.asarray(image @ np.array([0.299, 0.587, 0.114]))
