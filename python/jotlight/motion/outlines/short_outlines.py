"""Short outlines: regions with a large gain inside, and a short boundary."""

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine


def shortest_outlines(
    gain: npt.NDArray[np.float32], length: float, threads: int | None = None
) -> npt.NDArray[np.bool_]:
    """Return the pixels (H, W) whose gain minus the cost of their outline is largest.

    They are a level set of the minimizer m of ``length`` Σ |∇m| - Σ gain m with 0 ≤ m ≤ 1 (Chan,
    Esedoglu, and Nikolova 2006), which a primal-dual method finds (Chambolle and Pock 2011).

    Parameters
    ----------
    gain : ndarray of float32, shape (H, W)
        The gain of each pixel.
    length : float
        The cost of an outline per pixel of its length, above 0.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> gain = np.full((9, 9), -1, np.float32)
    >>> gain[2:7, 2:7] = 3
    >>> gain[4, 4] = -1  # too small for an outline
    >>> int(shortest_outlines(gain, 1.0).sum())
    25
    """
    pixels = np.empty(gain.shape, bool)
    engine.shortest_outlines(gain, length, pixels, threads)
    return pixels
