"""Square tiles: sums over them, and fields of displacements at their centers."""

import functools

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.squares import sum_squares

TILE = 16
"""Width of a tile in pixels."""


def tile_counts(size: tuple[int, int]) -> tuple[int, int]:
    """Return the numbers of rows and columns of tiles that cover an image.

    Examples
    --------
    >>> tile_counts((256, 500))
    (16, 32)
    """
    rows, columns = (-(-length // TILE) for length in size)
    return rows, columns


def tile_centers(size: tuple[int, int]) -> Array:
    """Return the positions of the centers of tiles in pixels, (2, rows, columns).

    Examples
    --------
    >>> tile_centers((16, 32))[1].tolist()
    [[7.5, 23.5]]
    """
    return TILE * np.indices(tile_counts(size), np.float64) + (TILE - 1) / 2


def sum_tiles(values: npt.NDArray[np.floating], tile: int = TILE) -> Array:
    """Return the sums over tiles, (..., rows, columns), of images (..., H, W).

    Examples
    --------
    >>> sum_tiles(np.ones((16, 20))).tolist()
    [[256.0, 64.0]]
    """
    *others, height, width = values.shape
    values = values.astype(np.float64, copy=False)
    if height % tile == 0:
        # The same sums in a third of the time.
        values = values.reshape(*others, height // tile, tile, width).sum(axis=-2)
    else:
        values = np.add.reduceat(values, np.arange(0, height, tile), axis=-2)
    return np.asarray(np.add.reduceat(values, np.arange(0, width, tile), axis=-1))


@functools.lru_cache(maxsize=8)
def affine_inverse(shape: tuple[int, int]) -> Array:
    """Return the pseudoinverse of :func:`affine_basis`, shape (3, rows * columns).

    It fits coefficients to a field. The array is shared, and cannot be changed.
    """
    inverse = np.asarray(np.linalg.pinv(affine_basis(shape)), np.float64)
    inverse.flags.writeable = False
    return inverse


@functools.lru_cache(maxsize=8)
def affine_basis(shape: tuple[int, int]) -> Array:
    """Return the functions 1, row, and column on a grid of tiles, shape (rows * columns, 3).

    Rows and columns are relative to the center, and in units of the whole grid. The array is
    shared, and cannot be changed.
    """
    rows, columns = np.indices(shape, np.float64)
    rows = (rows - (shape[0] - 1) / 2) / shape[0]
    columns = (columns - (shape[1] - 1) / 2) / shape[1]
    basis = np.stack([np.ones(shape), rows, columns], axis=-1).reshape(-1, 3)
    basis.flags.writeable = False
    return basis


def interpolate(
    nodes: npt.NDArray[np.floating], size: tuple[int, int], step: int = 1
) -> npt.NDArray[np.float32]:
    """Return the displacements of all pixels, (2, H, W), from those of tile centers.

    Between the centers, the displacements are interpolated linearly; beyond them, extrapolated.

    Parameters
    ----------
    nodes : ndarray of float, shape (2, rows, columns)
        Displacements at the centers of the tiles.
    size : (int, int)
        H and W.
    step : int
        Only every second, third, or nth row and column is computed.

    Examples
    --------
    >>> nodes = np.zeros((2, 1, 2))
    >>> nodes[1, 0] = 0, 16
    >>> interpolate(nodes, (1, 32))[1, 0, [0, 8, 31]].tolist()
    [-7.5, 0.5, 23.5]
    """
    rows = _between_centers(nodes.astype(np.float32), size[0], 1, step)
    return _between_centers(rows, size[1], 2, step)


def _between_centers(
    values: npt.NDArray[np.float32], length: int, axis: int, step: int = 1
) -> npt.NDArray[np.float32]:
    """Return values at every nth pixel along an axis, from those at the centers of tiles.

    A product with a matrix would start threads that compete with those of the engine.
    """
    first, fraction = _places(length, values.shape[axis], step)
    fraction = np.expand_dims(fraction, tuple(range(1, values.ndim - axis)))
    last = min(1, values.shape[axis] - 1)
    start = values.take(first, axis)
    return np.asarray(start + fraction * (values.take(first + last, axis) - start))


@functools.lru_cache(maxsize=8)
def _places(
    length: int, tiles: int, step: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]]:
    """Return the tile before every nth pixel, and the distance from its center in tiles."""
    place = (np.arange(0, length, step) - (TILE - 1) / 2) / TILE
    first = np.clip(np.floor(place), 0, max(0, tiles - 2)).astype(np.intp)
    return first, (place - first).astype(np.float32)


def interpolate_at(
    nodes: npt.NDArray[np.float32], places: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Return displacements at places (2, ...) in pixels, as :func:`interpolate` does.

    Those at the centers of tiles are (2, rows, columns), or several such fields.

    Examples
    --------
    >>> nodes = np.zeros((2, 1, 2), np.float32)
    >>> nodes[1, 0] = 0, 16
    >>> interpolate_at(nodes, np.array([[0.0], [8.5]], np.float32)).ravel().tolist()
    [0.0, 1.0]
    """
    index, fraction = [], []
    for place, tiles in zip(places, nodes.shape[-2:], strict=True):
        position = (place - (TILE - 1) / 2) / TILE
        first = np.clip(np.floor(position), 0, max(0, tiles - 2)).astype(int)
        index.append((first, np.minimum(first + 1, tiles - 1)))
        fraction.append((position - first).astype(np.float32))
    (top, bottom), (left, right) = index
    above = nodes[..., top, left] + fraction[1] * (nodes[..., top, right] - nodes[..., top, left])
    below = nodes[..., bottom, left] + fraction[1] * (
        nodes[..., bottom, right] - nodes[..., bottom, left]
    )
    return np.asarray(above + fraction[0] * (below - above), np.float32)


def add_squares(counts: npt.NDArray[np.generic], side: int) -> npt.NDArray[np.float32]:
    """Return the sums over squares. Those at the right and at the bottom may be incomplete."""
    return np.asarray(sum_squares(counts, side, beyond="empty"), np.float32)


def mean_tiles(values: npt.NDArray[np.floating], tile: int = TILE) -> Array:
    """Return the means over tiles, (..., rows, columns), of images (..., H, W)."""
    height, width = values.shape[-2:]
    return np.asarray(sum_tiles(values, tile) / _pixels_of_tiles((height, width), tile))


@functools.lru_cache(maxsize=8)
def _pixels_of_tiles(size: tuple[int, int], tile: int) -> Array:
    """Return the number of pixels of each tile."""
    return sum_tiles(np.ones(size), tile)
