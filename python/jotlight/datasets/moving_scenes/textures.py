"""Photographs as functions of continuous coordinates."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array

_BLUR = 0.6
"""Standard deviation in pixels of the blur that prevents aliasing when a photograph moves."""


class Texture:
    """A cubic spline through the pixels of a slightly blurred photograph.

    Beyond its borders, the photograph is mirrored.

    Parameters
    ----------
    photograph : ndarray of float, shape (H, W) or (H, W, C)
        Intensities of 0 or more.
    detail : int
        Number of pixels of the photograph per pixel of the sensor, in each dimension.

    Examples
    --------
    >>> texture = Texture(np.full((8, 9), 0.5))
    >>> texture(np.array([0.25, 100.0]), np.array([3.5, -20.0])).tolist()
    [0.5, 0.5]
    """

    def __init__(self, photograph: npt.NDArray[np.floating], detail: int = 1) -> None:
        from scipy.ndimage import gaussian_filter, spline_filter

        self.detail = detail
        self.size = photograph.shape[:2]
        self.channels = photograph.shape[2:]
        self._highest = max(1.0, float(photograph.max()))
        planes = photograph.reshape(*self.size, -1).astype(np.float64)
        self._coefficients = [
            spline_filter(gaussian_filter(plane, _BLUR, mode="mirror"), order=3, mode="mirror")
            for plane in np.moveaxis(planes, 2, 0)
        ]

    def __call__(self, rows: Array, columns: Array) -> npt.NDArray[np.float32]:
        """Return the intensities at some positions, with the channels as the last dimension."""
        from scipy.ndimage import map_coordinates

        channels = [
            map_coordinates(plane, [rows, columns], np.float32, 3, "mirror", prefilter=False)
            for plane in self._coefficients
        ]
        # The spline may exceed the range of the pixels.
        values = np.clip(np.stack(channels, axis=-1), 0, self._highest)
        return np.asarray(values if self.channels else values[..., 0])
