"""Rotation and zoom, from the scores of the velocities of windows.

In a scene that rotates, each window has another velocity. In dim light, no window alone shows its
own. But the velocities of all windows are an affine function of their positions, and the sum of the
scores of all windows along this function has a peak.
"""

import itertools

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Array, Array32

_ROTATIONS = range(-20, 21, 2)
_ZOOMS = range(-4, 5, 2)
"""Velocities by rotation and zoom at the outermost window, in steps of the scores."""

_NEAR = (-1, 0, 1)
"""Their differences from the best pair that are tried after it."""


def find_rotation(
    scores: Array32, centers: Array, line: Array, threads: int | None
) -> tuple[Array, Array] | None:
    """Return the affine velocity with the best total score of all windows, or None.

    Parameters
    ----------
    scores : ndarray of float32, shape (n, m, m)
        Scores of the velocities of n windows.
    centers : ndarray of float, shape (n, 2)
        Centers of the windows in pixels, relative to that of the image.
    line : ndarray of float, shape (m,)
        The velocities in rows and in columns, in pixels per frame.
    threads : int, optional
        The number of threads.

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
    rotation, zoom = 0, 0
    for rotations, zooms in ((_ROTATIONS, _ZOOMS), (_NEAR, _NEAR)):
        pairs = [(rotation + a, zoom + b) for a, b in itertools.product(rotations, zooms)]
        matrices = np.array([[[b, -a], [a, b]] for a, b in pairs]) / radius
        shifts = np.rint(centers @ matrices.transpose(0, 2, 1)).astype(np.int64)
        peaks = engine.peak_of_shifted_scores(scores, shifts, threads)
        best = max(range(len(pairs)), key=lambda index: peaks[index][0])
        rotation, zoom = pairs[best]
    _, (row, column) = peaks[best]
    matrix = (line[1] - line[0]) * matrices[best]
    return (np.array([line[row], line[column]]), matrix) if matrix.any() else None
