"""Velocities in a scene, from the correlations of short blocks of frames.

Two blocks of dim frames hardly correlate. The correlations of all pairs of blocks together do: if
something moves at the velocity v, those of pairs that are n frames apart have their peaks at n v.
Parts of the scene may have different velocities, so they are correlated in windows.
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from jotlight.motion.burst import Burst
from jotlight.motion.rotation import find_rotation
from jotlight.motion.tiles import tile_centers

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.float32]

_MAX_BLOCKS = 32
"""Maximum number of blocks that are correlated."""

_SHORT = 8
"""Longer blocks are shortened to a quarter, and others to a half."""

_LAGS = (1, 2, 3, 4, 6, 8, 12, 16)
"""Distances in blocks of the pairs that are correlated."""

_BIN = 2
"""Width of the squares whose counts are added, in pixels. Finer details hardly correlate."""

_WINDOW, _STRIDE = 96 // _BIN, 64 // _BIN
"""Width of a window, and maximum distance of neighboring windows, in bins."""

_WINDOWS_AT_ONCE = 16
"""Maximum number of windows that are correlated together."""

_RANGE = 0.45
"""Maximum displacement between two blocks, as a fraction of the width of a window."""

_BAND = 1.0 / _BIN, 12.0 / _BIN
"""Standard deviations of the filters between which details are correlated, in bins."""

_MIN_PEAK = 3.0
"""Minimum height of a peak, in standard deviations of the scores."""

_MAX_PEAKS = 3
"""Maximum number of velocities for each length of the blocks."""

_EXPLAINED = 0.7
"""A velocity explains a window if it has this fraction of the window's best score."""


def find_velocities(burst: Burst, reference: int, threads: int | None) -> Array:
    """Return the velocities around a reference time, (n, 2, rows, columns), in pixels per frame.

    They are fields of the velocities of tiles. The first one is 0. Others are constant, or a
    rotation with a zoom. Long blocks show slow motions best, and short ones fast motions.

    Parameters
    ----------
    burst : Burst
        T frames.
    reference : int
        The time between the two middle blocks.
    threads : int, optional
        Number of threads.
    """
    places = tile_centers(burst.size) - (np.array(burst.size).reshape(2, 1, 1) - 1) / 2
    found = [np.zeros_like(places)]
    for length in _lengths(min(reference, len(burst) - reference)):
        blocks = _count_blocks(burst, reference, length, threads)
        frames = length * len(blocks)
        for velocity, matrix in _peaks(blocks, length):
            field = velocity[:, None, None] + np.tensordot(matrix, places, axes=1)
            difference = np.hypot(*np.moveaxis(np.stack(found) - field, 1, 0)).max(axis=(1, 2))
            if (difference * frames > 2).all():
                found.append(field)
    return np.stack(found)


def _lengths(available: int) -> list[int]:
    """Return the lengths of blocks that are correlated, with a number of frames on each side.

    Examples
    --------
    >>> [_lengths(available) for available in (0, 10, 500)]
    [[], [1], [31, 7, 3, 1]]
    """
    lengths = []
    length = max(1, 2 * available // _MAX_BLOCKS) if available > 0 else 0
    while length > 0:
        lengths.append(length)
        length = length // 4 if length > _SHORT else length // 2
    return lengths


def _count_blocks(burst: Burst, reference: int, length: int, threads: int | None) -> Images:
    """Return the counts of blocks of frames around a time, in squares of pixels, (n, h, w)."""
    number = min(_MAX_BLOCKS, 2 * (min(reference, len(burst) - reference) // length))
    start = reference - number // 2 * length
    starts = range(start, start + number * length, length)
    counts = [_bin(burst.counts(range(first, first + length), threads)) for first in starts]
    return np.stack(counts)


def _bin(counts: npt.NDArray[np.int32]) -> Images:
    """Return the sums over squares, without the rest at the right and at the bottom."""
    side = _BIN if min(counts.shape) > _BIN else 1
    height, width = (length // side * side for length in counts.shape)
    rows = np.sum([counts[row:height:side] for row in range(side)], axis=0)
    columns = [rows[:, column:width:side] for column in range(side)]
    return np.asarray(np.sum(columns, axis=0), np.float32)


def _peaks(blocks: Images, length: int) -> Iterator[tuple[Array, Array]]:
    """Yield the best velocities, each with the matrix by which it changes per pixel.

    The first one is that of the whole image, and the second is a rotation. The third is the best
    one of all windows together. The others are the best ones of windows that the third one and
    those after it do not explain.
    """
    constant = np.zeros((2, 2))
    lags = [lag for lag in _LAGS if lag < len(blocks)]
    if not lags:
        return
    windows = np.stack(list(_windows(blocks)))
    width = min(windows.shape[2:])
    steps = int(_RANGE * width)
    line = _BIN * np.arange(-steps, steps + 1) / (length * lags[-1])
    every = list(range(1, lags[-1] + 1))
    (whole,) = _scores(blocks[None], every, line * (length / _BIN))
    if (velocity := _best(whole, line)) is not None:
        yield velocity, constant
    parts = np.array_split(windows, -(-len(windows) // _WINDOWS_AT_ONCE))
    scores = np.concatenate([_scores(part, lags, line * (length / _BIN)) for part in parts])
    if (rotation := find_rotation(scores, _BIN * _window_centers(blocks), line)) is not None:
        yield rotation
    active = np.ones(len(scores), bool)
    best = scores.reshape(len(scores), -1).max(axis=1)
    for _ in range(_MAX_PEAKS):
        total = scores[active].sum(axis=0)
        if (velocity := _best(total, line)) is not None:
            yield velocity, constant
        row, column = np.unravel_index(int(np.argmax(total)), total.shape)
        active &= scores[:, row, column] < _EXPLAINED * best
        if not active.any():
            return


def _best(scores: npt.NDArray[np.float32], line: Array) -> Array | None:
    """Return the velocity with the best score, or None if it is not a clear peak."""
    row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
    last = len(line) - 1
    is_clear = scores[row, column] - scores.mean() >= _MIN_PEAK * scores.std()
    if not is_clear or row in (0, last) or column in (0, last):
        return None
    return np.array([line[row], line[column]])


def _windows(blocks: Images) -> Iterator[Images]:
    """Yield parts of the blocks that overlap, (n, h, w)."""
    rows, columns = (_starts(length) for length in blocks.shape[1:])
    for row in rows:
        for column in columns:
            yield blocks[:, row : row + _WINDOW, column : column + _WINDOW]


def _window_centers(blocks: Images) -> Array:
    """Return the centers of the windows, (n, 2), relative to that of the image."""
    rows, columns = (
        np.array(_starts(length)) + (min(length, _WINDOW) - length) / 2
        for length in blocks.shape[1:]
    )
    return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)


def _starts(length: int) -> list[int]:
    number = 1 + max(0, -(-(length - _WINDOW) // _STRIDE))
    return [round(start) for start in np.linspace(0, max(0, length - _WINDOW), number)]


def _scores(windows: Images, lags: list[int], line: Array) -> Images:
    """Return the scores of displacements per block, in units of the noise of the correlations.

    Parameters
    ----------
    windows : ndarray of float32, shape (w, n, h, w)
        Counts of the n blocks in each window.
    lags : list of int
        Distances of the pairs.
    line : ndarray of float, shape (m,)
        Displacements per block, in rows and in columns.

    Returns
    -------
    ndarray of float32, shape (w, m, m)
        Scores of each window.
    """
    from scipy import fft

    height, width = windows.shape[2:]
    taper = (np.hanning(height)[:, None] * np.hanning(width)).astype(np.float32)
    squared = (2 * np.pi * fft.fftfreq(height)[:, None]) ** 2
    squared = squared + (2 * np.pi * fft.rfftfreq(width)) ** 2
    fine, coarse = (np.exp(-squared * sigma**2 / 2) for sigma in _BAND)
    band = (fine - coarse).astype(np.float32)
    mean = windows.mean(axis=(2, 3), keepdims=True)
    spectra = fft.rfft2((windows - mean) * taper) * band
    conjugate = np.conj(spectra)
    total = np.zeros((len(windows), len(line), len(line)), np.float32)
    for lag in lags:
        cross = np.einsum("wnij,wnij->wij", conjugate[:, :-lag], spectra[:, lag:])
        magnitude = abs(cross)
        largest = magnitude.max(axis=(1, 2), keepdims=True)
        # The root is between correlation, whose peaks are wide, and phase correlation.
        cross /= np.sqrt(magnitude + np.float32(1e-9) * largest + np.float32(1e-30))
        correlation = fft.irfft2(cross, s=(height, width))
        correlation /= np.maximum(correlation.std(axis=(1, 2), keepdims=True), np.float32(1e-30))
        for axis, size in ((1, height), (2, width)):
            correlation = _interpolate(correlation, lag * line, axis, size)
        total += correlation
    return total


def _interpolate(values: Images, places: Array, axis: int, size: int) -> Images:
    """Return `size` periodic values along an axis, interpolated linearly at the places.

    Products with sparse matrices would be slower.
    """
    first = np.floor(places).astype(int)
    shape = [1] * values.ndim
    shape[axis] = len(places)
    fraction = (places - first).astype(np.float32).reshape(shape)
    before, after = (values.take((first + step) % size, axis=axis) for step in (0, 1))
    return np.asarray(before + fraction * (after - before), np.float32)
