"""Parts of an image that together contain the pixels of a map."""

import itertools

import numpy as np
import numpy.typing as npt

Region = tuple[slice, slice]

_CELLS = 8, 32
"""Sides of the cells of which regions consist, in pixels. Large ones need fewer halos."""


def cover(needed: npt.NDArray[np.bool_], halo: int) -> list[Region]:
    """Return disjoint rectangles of rows and columns that contain all needed pixels.

    They are the whole image where it has no more pixels than they have together with their halos.
    They consist of square cells of 8 or 32 pixels, whichever have fewer pixels with their halos.

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
    [(slice(0, 40, None), slice(64, 80, None))]
    >>> cover(needed, 300)
    [(slice(0, 100, None), slice(0, 300, None))]
    """
    height, width = needed.shape
    best, least = [(slice(0, height), slice(0, width))], needed.size
    fine = _any_of_squares(needed, _CELLS[0])
    for side in _CELLS:
        cells = _any_of_squares(fine, side // _CELLS[0])
        regions = [
            (
                slice(top * side, min(bottom * side, height)),
                slice(left * side, min(right * side, width)),
            )
            for top, bottom, left, right in _rectangles(cells)
        ]
        area = sum(_size(widen(region, halo, needed.shape)) for region in regions)
        if area < least:
            best, least = regions, area
    return best


def _any_of_squares(needed: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """Return whether squares have a needed pixel. The last ones may be incomplete."""
    height, width = needed.shape
    padded = np.pad(needed, ((0, -height % side), (0, -width % side)))
    rows = np.asarray(padded.reshape(-1, side, padded.shape[1]).any(axis=1), np.bool_)
    return np.asarray(rows.reshape(len(rows), -1, side).any(axis=2), np.bool_)


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
    padded = np.zeros((cells.shape[0] + 1, cells.shape[1] + 2), bool)
    padded[:-1, 1:-1] = cells
    rows, edges = np.nonzero(padded[:, 1:] != padded[:, :-1])
    starts = np.searchsorted(rows, np.arange(len(padded) + 1)).tolist()
    of_rows = edges.tolist()
    for row, (first, last) in enumerate(itertools.pairwise(starts)):
        lefts, rights = of_rows[first:last:2], of_rows[first + 1 : last : 2]
        runs = list(zip(lefts, rights, strict=True))
        found += [(top, row, *run) for run, top in growing.items() if run not in runs]
        growing = {run: growing.get(run, row) for run in runs}
    return found


def _size(region: Region) -> int:
    rows, columns = region
    return int((rows.stop - rows.start) * (columns.stop - columns.start))
