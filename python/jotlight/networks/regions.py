"""Parts of an image that together contain the pixels of a map."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

_CELL = 8
"""Side of the cells of which regions consist, in pixels."""

_MAX_ROWS = 32
"""Maximum number of rows of cells between which an image is divided into bands."""

_ROW_COST = 64
"""Time that a network takes for each row of an image, in units of that for a pixel."""


@dataclasses.dataclass(frozen=True)
class Band:
    """Neighboring rows of an image, of which only some runs of columns are needed.

    The parts of an image around these runs are denoised side by side, as one image. Each needed
    pixel lies at least a halo away from the border of a part, unless the image ends there.
    """

    rows: slice
    """The needed rows."""
    wide_rows: slice
    """The rows, with a halo above and below."""
    runs: tuple[slice, ...]
    """The columns of the parts."""

    def cut(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the parts of an image (H, W), side by side.

        Examples
        --------
        >>> band = Band(slice(0, 1), slice(0, 2), (slice(0, 2), slice(4, 5)))
        >>> band.cut(np.arange(10).reshape(2, 5)).tolist()
        [[0, 1, 4], [5, 6, 9]]
        """
        return np.concatenate([image[self.wide_rows, run] for run in self.runs], axis=1)

    def pieces(
        self, parts: npt.NDArray[Any]
    ) -> Iterator[tuple[tuple[slice, slice], npt.NDArray[Any]]]:
        """Yield the needed rows of each part: where they are in the image, and their values.

        Examples
        --------
        >>> band = Band(slice(0, 1), slice(0, 2), (slice(0, 2), slice(4, 5)))
        >>> for (rows, columns), values in band.pieces(np.array([[0, 1, 4], [5, 6, 9]])):
        ...     print(columns.start, values.tolist())
        0 [[0, 1]]
        4 [[4]]
        """
        top, left = self.rows.start - self.wide_rows.start, 0
        rows = slice(top, top + self.rows.stop - self.rows.start)
        for run in self.runs:
            right = left + run.stop - run.start
            yield (self.rows, run), parts[rows, left:right]
            left = right


def cover(needed: npt.NDArray[np.bool_], halo: int) -> list[Band]:
    """Return bands of an image, one below the other, that contain all needed pixels.

    They are those for which a network takes the least time: each of them costs halos, but bands
    with few rows leave out more columns.

    Parameters
    ----------
    needed : ndarray of bool, shape (H, W)
        The pixels.
    halo : int
        Number of pixels around a needed one that it depends on.

    Examples
    --------
    >>> needed = np.zeros((100, 300), bool)
    >>> needed[:40, 70:80] = needed[:40, 280:] = True
    >>> cover(needed, 4)  # doctest: +NORMALIZE_WHITESPACE
    [Band(rows=slice(0, 40, None), wide_rows=slice(0, 44, None),
          runs=(slice(60, 84, None), slice(276, 300, None)))]
    """
    height, width = needed.shape
    in_rows = np.flatnonzero(needed.any(axis=1)) // _CELL
    side = max(1, -(-height // (_MAX_ROWS * _CELL)))
    cells = _any_of_cells(needed, side)
    bands: list[Band] = []
    if not len(in_rows):
        return bands
    for first, end in _divide(cells, side, halo, needed.shape):
        top, bottom = np.searchsorted(in_rows, (side * first, side * end))
        last = int(in_rows[bottom - 1])
        rows = slice(_CELL * int(in_rows[top]), min(_CELL * (last + 1), height))
        runs = _runs(cells[first:end].any(axis=0), halo, width)
        bands.append(Band(rows, _widen(rows, halo, height), runs))
    return bands


def _any_of_cells(needed: npt.NDArray[np.bool_], side: int) -> npt.NDArray[np.bool_]:
    """Return whether groups of `side` cells, one below the other, have a needed pixel."""
    columns = np.logical_or.reduceat(needed, np.arange(0, needed.shape[1], _CELL), axis=1)
    rows = np.logical_or.reduceat(columns, np.arange(0, len(needed), side * _CELL), axis=0)
    return np.asarray(rows, np.bool_)


def _divide(
    cells: npt.NDArray[np.bool_], side: int, halo: int, size: tuple[int, int]
) -> list[tuple[int, int]]:
    """Return the first row of cells and the end of each band that has needed cells."""
    number, height = len(cells), side * _CELL
    # The least time for all rows from one on, and the end of the first band then.
    least, ends = np.zeros(number + 1), np.zeros(number, int)
    for first in range(number - 1, -1, -1):
        union = np.logical_or.accumulate(cells[first:], axis=0)
        bottoms = np.minimum(height * np.arange(first + 1, number + 1) + halo, size[0])
        rows = bottoms - max(height * first - halo, 0)
        times = rows * (_ROW_COST + _widths(union, halo, size[1])) * union.any(axis=1)
        times = times + least[first + 1 :]
        best = int(np.argmin(times))
        least[first], ends[first] = times[best], first + 1 + best
    bands, first = [], 0
    while first < number:
        if cells[first : ends[first]].any():
            bands.append((first, int(ends[first])))
        first = int(ends[first])
    return bands


def _widths(cells: npt.NDArray[np.bool_], halo: int, width: int) -> npt.NDArray[np.intp]:
    """Return about how many columns the parts of bands have, each given by a row of cells."""
    reach = -(-halo // _CELL)
    sums = np.cumsum(np.pad(cells, ((0, 0), (reach + 1, reach))), axis=1)
    near = sums[:, 2 * reach + 1 :] > sums[:, : cells.shape[1]]
    return np.asarray(np.minimum(_CELL * near.sum(axis=1), width))


def _runs(cells: npt.NDArray[np.bool_], halo: int, width: int) -> tuple[slice, ...]:
    """Return the columns around needed cells. Runs that would overlap are one run."""
    edges = np.flatnonzero(np.diff(cells.astype(np.int8), prepend=0, append=0))
    runs: list[slice] = []
    for first, end in edges.reshape(-1, 2).tolist():
        run = _widen(slice(_CELL * first, min(_CELL * end, width)), halo, width)
        if runs and runs[-1].stop >= run.start:
            run = slice(runs.pop().start, run.stop)
        runs.append(run)
    return tuple(runs)


def _widen(part: slice, halo: int, length: int) -> slice:
    """Return rows or columns with the halo on both sides of them that lies in the image."""
    return slice(max(part.start - halo, 0), min(part.stop + halo, length))
