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
    # A byte of packed pixels is a row of a cell.
    packed = np.packbits(needed, axis=1)
    in_rows = np.flatnonzero(packed.any(axis=1)) // _CELL
    side = max(1, -(-height // (_MAX_ROWS * _CELL)))
    cells = np.logical_or.reduceat(packed, np.arange(0, height, side * _CELL), axis=0)
    bands: list[Band] = []
    if not len(in_rows):
        return bands
    for first, end in _divide(cells, side, halo, needed.shape):
        top, bottom = np.searchsorted(in_rows, (side * first, side * end))
        last = int(in_rows[bottom - 1])
        rows = slice(_CELL * int(in_rows[top]), min(_CELL * (last + 1), height))
        runs = _runs(np.logical_or.reduce(cells[first:end], axis=0), halo, width)
        bands.append(Band(rows, _widen(rows, halo, height), runs))
    return bands


def _divide(
    cells: npt.NDArray[np.bool_], side: int, halo: int, size: tuple[int, int]
) -> list[tuple[int, int]]:
    """Return the first row of cells and the end of each band that has needed cells."""
    number, height = len(cells), side * _CELL
    widths = _widths(cells, halo, size[1])
    starts = np.arange(0, number * height, height)
    rows = np.minimum(starts + height + halo, size[0]) - np.maximum(starts - halo, 0)[:, None]
    times = rows * np.where(widths > 0, _ROW_COST + widths, 0)
    # The least time for all rows from one on, and the end of the first band then.
    least, ends = np.zeros(number + 1), np.zeros(number, int)
    for first in range(number - 1, -1, -1):
        of_rest = times[first, first:] + least[first + 1 :]
        best = int(np.argmin(of_rest))
        least[first], ends[first] = of_rest[best], first + 1 + best
    bands, first = [], 0
    while first < number:
        if cells[first : ends[first]].any():
            bands.append((first, int(ends[first])))
        first = int(ends[first])
    return bands


def _widths(cells: npt.NDArray[np.bool_], halo: int, width: int) -> npt.NDArray[np.intp]:
    """Return about how many columns the parts have of bands from each row of cells to each other.

    They are 0 for bands without needed cells.
    """
    near, reach = cells.copy(), -(-halo // _CELL)
    for shift in range(1, min(reach, cells.shape[1] - 1) + 1):
        near[:, shift:] |= cells[:, :-shift]
        near[:, :-shift] |= cells[:, shift:]
    rows = np.arange(len(cells))
    bands = near & (rows >= rows[:, None])[:, :, None]
    np.logical_or.accumulate(bands, axis=1, out=bands)
    return np.asarray(np.minimum(_CELL * np.count_nonzero(bands, axis=2), width))


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
