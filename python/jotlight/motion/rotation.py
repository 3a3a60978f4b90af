"""Rotation and zoom, from the scores of the velocities of windows.

In a scene that rotates, each window has another velocity. In dim light, no window alone shows its
own. But the velocities of all windows are an affine function of their positions, and the sum of the
scores of all windows along this function has a peak.
"""

import itertools
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Scores = npt.NDArray[np.float32]

_ROTATIONS = range(-20, 21, 2)
_ZOOMS = range(-4, 5, 2)
"""Velocities by rotation and zoom at the outermost window, in steps of the scores.

The neighbors of the best pair are tried, too.
"""


def find_rotation(scores: Scores, centers: Array, line: Array) -> tuple[Array, Array] | None:
    """Return the affine velocity with the best total score of all windows, or None.

    Parameters
    ----------
    scores : ndarray of float32, shape (n, m, m)
        Scores of the velocities of n windows.
    centers : ndarray of float, shape (n, 2)
        Centers of the windows in pixels, relative to that of the image.
    line : ndarray of float, shape (m,)
        The velocities in rows and in columns, in pixels per frame.

    Returns
    -------
    None
        If a constant velocity is the best one, or there are fewer than three windows.
    velocity : ndarray of float, shape (2,)
        The velocity of the center of the image, in pixels per frame.
    matrix : ndarray of float, shape (2, 2)
        By how much the velocity changes per pixel: a rotation and a zoom.
    """
    radius = float(np.hypot(*centers.T).max())
    if len(scores) < 3 or radius == 0 or len(line) < 2:
        return None
    step = line[1] - line[0]

    def evaluate(rotation: int, zoom: int) -> tuple[float, Array, Array]:
        matrix = np.array([[zoom, -rotation], [rotation, zoom]]) / radius
        total = _sum_shifted(scores, np.rint(centers @ matrix.T).astype(int))
        row, column = np.unravel_index(int(total.argmax()), total.shape)
        return float(total[row, column]), np.array([line[row], line[column]]), step * matrix

    def best(pairs: Iterable[tuple[int, int]]) -> tuple[int, int]:
        return max(pairs, key=lambda pair: evaluate(*pair)[0])

    rotation, zoom = best(itertools.product(_ROTATIONS, _ZOOMS))
    near = itertools.product((rotation - 1, rotation, rotation + 1), (zoom - 1, zoom, zoom + 1))
    _, velocity, matrix = evaluate(*best(near))
    return (velocity, matrix) if matrix.any() else None


def _sum_shifted(scores: Scores, shifts: npt.NDArray[np.intp]) -> Scores:
    """Return the sum of scores (n, m, m) at indices that are increased by shifts (n, 2)."""
    length = scores.shape[1]
    total = np.zeros((length, length), np.float32)
    for each, (row, column) in zip(scores, shifts.tolist(), strict=True):
        top, left = max(0, row), max(0, column)
        part = each[top : length + row, left : length + column]
        height, width = part.shape
        total[top - row : top - row + height, left - column : left - column + width] += part
    return total
