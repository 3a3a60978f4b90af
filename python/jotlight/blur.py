"""The Gaussian filter of the engine, for one image or several."""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine


def blur(
    images: npt.NDArray[np.floating], sigma: float, threads: int | None = None
) -> npt.NDArray[np.float32]:
    """Return an image (H, W), or each of several (N, H, W), after a Gaussian filter.

    Parameters
    ----------
    images : ndarray of float, shape (H, W) or (N, H, W)
        The images. They are mirrored beyond their borders.
    sigma : float
        The standard deviation of the filter in pixels, above 0 and at most 100.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Raises
    ------
    ValueError
        When `sigma` is outside its range.

    Examples
    --------
    >>> blur(np.array([[0, 0, 16, 0, 0]], np.float32), 1.0).round().tolist()
    [[1.0, 4.0, 6.0, 4.0, 1.0]]
    """
    source = np.ascontiguousarray(images, np.float32)
    out = np.empty_like(source)
    stack = (-1, *source.shape[-2:])
    engine.blur(source.reshape(stack), sigma, out.reshape(stack), threads)
    return out
