"""Change of the reference time of a motion."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array32
from jotlight.motion.tiles import TILE, interpolate_at

_ROUNDS = 8
"""Rounds of the fixed-point iteration that inverts a displacement."""

_FAR = np.float32(1e6)
"""Largest coordinate of an origin in pixels."""


def move_nodes(nodes: Array32, now: Array32) -> Array32:
    """Return displacements (n, 2, rows, columns) as seen from a new reference time.

    The scene point at the new time is at x. At the old one it was at y with y + u(y, new) = x, so
    its new displacement is u(y, t) - u(y, new).

    Parameters
    ----------
    nodes : ndarray of float32, shape (n, 2, rows, columns)
        Displacements at the centers of the tiles, as seen from the old reference time.
    now : ndarray of float32, shape (2, rows, columns)
        Displacements at the new reference time.
    """
    centers = np.indices(now.shape[1:], np.float32) * TILE + np.float32((TILE - 1) / 2)
    origin = _origins(centers, now)
    return interpolate_at(nodes, origin) - interpolate_at(now, origin)


def move_labels(labels: npt.NDArray[np.uint8], now: Array32) -> npt.NDArray[np.uint8]:
    """Return the labels (H, W) as seen from a new reference time.

    Parameters
    ----------
    labels : ndarray of uint8, shape (H, W)
        Index of the field of each pixel, as seen from the old reference time.
    now : ndarray of float32, shape (m, 2, rows, columns)
        Displacements of each field at the new reference time.

    Notes
    -----
    A pixel that several fields claim belongs to the rarest of them, since objects hide their
    background. A pixel that none claims belongs to the most frequent one.
    """
    numbers = np.bincount(labels.ravel(), minlength=len(now))
    if numbers.max() == labels.size:
        return labels.copy()
    moved = np.full(labels.shape, int(numbers.argmax()), np.uint8)
    pixels = np.indices(labels.shape, np.float32)
    limits = np.array(labels.shape).reshape(2, 1, 1) - 1
    for index in np.argsort(-numbers, kind="stable"):
        if numbers[index] == 0:
            continue
        rows, columns = np.clip(np.rint(_origins(pixels, now[index])), 0, limits).astype(int)
        moved[labels[rows, columns] == index] = index
    return moved


def _origins(places: Array32, now: Array32) -> Array32:
    """Return the places y with y + u(y) = x for places x, (2, ...)."""
    origin = places
    for _ in range(_ROUNDS):
        # Impossible motions may diverge.
        before, origin = origin, np.clip(places - interpolate_at(now, origin), -_FAR, _FAR)
        if np.array_equal(origin, before):
            break
    return origin
