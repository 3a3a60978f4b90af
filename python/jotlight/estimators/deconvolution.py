"""Deconvolution: from the mean light of each pixel's jots to the image, for smooth kernels."""

from functools import cache

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.sensing.likelihood.operators import spread
from jotlight.sensing.sensor import Sensor

_REGULARIZATION = 0.1
"""λ in :func:`inverse_taps`.

For networks and K from 4 to 1,000, values from 0.04 to 0.1 differ by up to 0.2 dB
(``benchmarks/studies/smooth_kernels.py``).
"""

DECONVOLUTION_RADIUS = 32
"""Number of taps of the inverse filter on each side. Those beyond are below 1e-5."""

_PERIOD = 256


def deconvolve(means: Image, sensor: Sensor) -> Image:
    """Return the image whose light, spread by the kernel, has these means over each pixel.

    The kernel is a B-spline. It is separable, so its regularized inverse runs along the columns and
    along the rows. With the box kernel, the means are the image.

    Parameters
    ----------
    means : ndarray of float32, shape (..., H, W)
        Mean intensity at the jots of each pixel.
    sensor : Sensor
        The kernel, and the number of jots per pixel.

    Examples
    --------
    >>> image = np.zeros((9, 9), np.float32)
    >>> image[4, 4] = 1
    >>> sensor = jl.Sensor(oversampling=4, kernel="cubic")
    >>> sharp = deconvolve(image, sensor)
    >>> print(sharp[4, 3:6].round(2))
    [-0.26  1.95 -0.26]
    """
    if sensor.kernel == "box":
        return means
    from scipy.ndimage import convolve1d

    taps = inverse_taps(sensor.kernel, sensor.oversampling)
    for axis in (-2, -1):
        # The light beyond the border is mirrored (decision 2).
        means = convolve1d(means, taps, axis=axis, mode="reflect")
    return means


@cache
def inverse_taps(kernel: str, oversampling: int) -> npt.NDArray[np.float64]:
    """Return the taps of the regularized inverse of a kernel, averaged over pixels, along a line.

    Its frequency response is (1 + λ) T* / (|T|² + λ), where T is that of the averaged kernel. So
    the mean intensity does not change, and frequencies that the kernel suppresses stay weak.
    """
    point = np.zeros(_PERIOD)
    point[_PERIOD // 2] = 1
    line = spread((_PERIOD,), oversampling, kernel, gain=oversampling).forward(point)
    response = np.fft.rfft(np.roll(line.reshape(_PERIOD, -1).mean(1), -(_PERIOD // 2)))
    inverse = (1 + _REGULARIZATION) * response.conj() / (abs(response) ** 2 + _REGULARIZATION)
    centered = np.roll(np.fft.irfft(inverse, _PERIOD), DECONVOLUTION_RADIUS)
    taps = centered[: 2 * DECONVOLUTION_RADIUS + 1]
    return np.asarray(taps / taps.sum())
