"""Parts of an image that together contain the pixels of a map."""

import numpy as np
import numpy.typing as npt

Region = tuple[slice, slice]

_CELL = 32
"""Side of the cells of which regions consist, in pixels."""


def cover(needed: npt.NDArray[np.bool_], halo: int) -> list[Region]:
    """Return disjoint rectangles of rows and columns that contain all needed pixels.

    They are the whole image where it has no more pixels than they have together with their halos.

    Parameters
    ----------
    needed : ndarray of bool, shape (H, W)
        The pixels.
    halo : int
        Number of pixels around a rectangle that its pixels depend on.

    Examples
    --------
    >>> needed = np.zeros((100, 300), bool)
    >>> needed[:40, 70:80] = True
    >>> cover(needed, 4)
    [(slice(0, 64, None), slice(64, 96, None))]
    >>> cover(needed, 300)
    [(slice(0, 100, None), slice(0, 300, None))]
    """
    height, width = needed.shape
    padded = np.pad(needed, ((0, -height % _CELL), (0, -width % _CELL)))
    squares = padded.reshape(-1, _CELL, padded.shape[1] // _CELL, _CELL)
    cells = np.asarray(squares.any(axis=(1, 3)))
    regions = [
        (
            slice(top * _CELL, min(bottom * _CELL, height)),
            slice(left * _CELL, min(right * _CELL, width)),
        )
        for top, bottom, left, right in _rectangles(cells)
    ]
    area = sum(_size(widen(region, halo, needed.shape)) for region in regions)
    return regions if area < needed.size else [(slice(0, height), slice(0, width))]


def widen(region: Region, halo: int, shape: tuple[int, ...]) -> Region:
    """Return a region with the halo around it that lies in the image.

    Examples
    --------
    >>> widen((slice(0, 32), slice(32, 64)), 8, (100, 70))
    (slice(0, 40, None), slice(24, 70, None))
    """
    rows, columns = (
        slice(max(part.start - halo, 0), min(part.stop + halo, size))
        for part, size in zip(region, shape, strict=True)
    )
    return rows, columns


def _rectangles(cells: npt.NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Return the top, bottom, left, and right of disjoint rectangles that cover all true cells."""
    found: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    for row, line in enumerate([*cells, np.zeros(cells.shape[1], bool)]):
        edges = np.flatnonzero(np.diff(line, prepend=False, append=False))
        runs = [(int(left), int(right)) for left, right in edges.reshape(-1, 2)]
        found += [(top, row, *run) for run, top in growing.items() if run not in runs]
        growing = {run: growing.get(run, row) for run in runs}
    return found


def _size(region: Region) -> int:
    rows, columns = region
    return int((rows.stop - rows.start) * (columns.stop - columns.start))
