"""The pixels of a film that are brighter than its white, which only some of its images decide."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn

_MAX_BRIGHT = 0.05
"""Fraction of an image that may be brighter than the percentile of others.

In 14 of 24 ordinary films, noise and motion brought 1.6 to 2.7 % of an image above it (ad hoc).
"""


class Clipping:
    """Counts the pixels that are brighter than the white of a film.

    Parameters
    ----------
    white : float
        The value that becomes white.
    is_percentile : bool
        Whether white is a high percentile of some of the images. Then 5 % of the pixels of each
        image may be brighter. Otherwise, none may be.

    Examples
    --------
    >>> import warnings
    >>> clipping = Clipping(1.0)
    >>> for image in np.array([[[0.5, 0.5]], [[3.0, 0.5]]]):
    ...     clipping.count(image)
    >>> with warnings.catch_warnings(record=True) as warned:
    ...     warnings.simplefilter("always")
    ...     clipping.report()
    >>> print(warned[0].message)
    images: 50 % of the pixels of image 1 are brighter than white, 1; white=3 (--white 3) shows ...
    """

    def __init__(self, white: float, is_percentile: bool = False) -> None:
        self._white, self._is_percentile = white, is_percentile
        self._number = 0
        """Number of images so far."""
        self._images: list[int] = []
        self._bright = self._pixels = 0
        self._largest = 0.0

    def count(self, image: npt.NDArray[Any]) -> None:
        """Count the pixels of the next image, (H, W) or (H, W, C)."""
        brightest = image.max(axis=2) if image.ndim == 3 else image
        is_bright = brightest > self._white
        bright = int(np.count_nonzero(is_bright))
        # The brightest pixel of a small image is always above the percentile.
        if bright > (_MAX_BRIGHT * is_bright.size + 1 if self._is_percentile else 0):
            self._images.append(self._number)
            self._bright += bright
            self._pixels += is_bright.size
            self._largest = max(self._largest, float(image.max()))
        self._number += 1

    def report(self, advice: str = "") -> None:
        """Warn about the images that were counted. The `advice` follows that about white."""
        if self._images:
            first, number = self._images[0], len(self._images)
            where = f"{number} images, the first of them image {first}," if number > 1 else ""
            white = f"{self._largest:.3g}"
            warn(
                f"images: {100 * self._bright / self._pixels:.3g} % of the pixels of "
                f"{where or f'image {first}'} are brighter than white, {self._white:.3g}; "
                f"white={white} (--white {white}) shows the largest value{advice}"
            )
