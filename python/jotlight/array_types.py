"""The types of arrays in signatures. Each has one name, which says what the numbers are.

A function states the shapes of its arrays in its docstring.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
"""Real numbers in double precision."""

Array32 = npt.NDArray[np.float32]
"""Real numbers in single precision that are no image."""

Image = npt.NDArray[np.float32]
"""Images, or maps of the pixels, in single precision."""

AnyArray = npt.NDArray[Any]
"""Numbers of any type."""

FloatImage = npt.NDArray[np.floating[Any]]
"""An image (H, W) or (H, W, 3) of floats, in any precision."""

Colors = npt.NDArray[np.float64]
"""Colors in double precision, on the last axis."""

Mask = npt.NDArray[np.bool_]
"""True or False for each pixel, jot, or other thing."""

Counts = npt.NDArray[np.int32]
"""Numbers of ones, L."""

Integers = npt.NDArray[np.int64]
"""Whole numbers in 64 bits, such as positions and large counts."""

AnyIntegers = npt.NDArray[np.integer[Any]]
"""Whole numbers of any type."""

Packed = npt.NDArray[np.uint8]
"""Packed bits, uint8 (T, H, ceil(W / 8)). The most significant bit of a byte is its first jot."""

Levels = npt.NDArray[np.uint8]
"""Levels of brightness from 0 to 255, as files and displays take them."""

Pattern = npt.NDArray[np.uint8]
"""The number of the color filter of each pixel, or of each pixel of a period."""

Labels = npt.NDArray[np.uint8]
"""The number of the object of each pixel."""
