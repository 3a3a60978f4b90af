"""Short outlines: regions with a large gain inside, and a short boundary."""

import numpy as np
import numpy.typing as npt

_ITERATIONS = 150
"""Number of iterations."""

_STEP = 0.35
"""Length of the steps, for a length of outlines that costs 1."""


def shortest_outlines(gain: npt.NDArray[np.float32], length: float) -> npt.NDArray[np.bool_]:
    """Return the pixels (H, W) whose gain minus the cost of their outline is largest.

    They are a level set of the minimizer m of ``length`` Σ |∇m| - Σ gain m with 0 ≤ m ≤ 1 (Chan,
    Esedoglu, and Nikolova 2006), which a primal-dual method finds (Chambolle and Pock 2011).

    Parameters
    ----------
    gain : ndarray of float32, shape (H, W)
        The gain of each pixel.
    length : float
        The cost of an outline per pixel of its length, above 0.

    Examples
    --------
    >>> gain = np.full((9, 9), -1, np.float32)
    >>> gain[2:7, 2:7] = 3
    >>> gain[4, 4] = -1  # too small for an outline
    >>> int(shortest_outlines(gain, 1.0).sum())
    25
    """
    inside = (gain > 0).astype(np.float32)
    ahead = inside.copy()
    flow = np.zeros((2, *gain.shape), np.float32)
    step, dual = np.float32(_STEP / length), np.float32(length / (8 * _STEP))
    gain = gain * step
    for _ in range(_ITERATIONS):
        flow[0, :-1] += dual * (ahead[1:] - ahead[:-1])
        flow[1, :, :-1] += dual * (ahead[:, 1:] - ahead[:, :-1])
        flow /= np.maximum(1, np.sqrt(flow[0] ** 2 + flow[1] ** 2) / np.float32(length))
        divergence = flow[0] + flow[1]
        divergence[1:] -= flow[0, :-1]
        divergence[:, 1:] -= flow[1, :, :-1]
        before = inside
        inside = np.clip(before + step * divergence + gain, 0, 1)
        ahead = 2 * inside - before
    return np.asarray(inside > 0.5)
