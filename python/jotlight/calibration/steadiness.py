"""Tests of the likelihood's assumption that frames are independent and identically distributed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.progress import Progress, check_progress, shown_progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.counting import check_mask
from jotlight.sensing.bits.frames import Frames, read_frames

BLOCKS = 16
"""Number of blocks of frames whose counts are compared, from 256 frames on.

Blocks have whole frames. So there are up to 19 of them for fewer frames, for example for 79.
"""

_MIN_FRAMES = 8


@dataclasses.dataclass(frozen=True, eq=False)
class Steadiness:
    """The results of the tests of the frames of a capture. Two are equal if all values are.

    Parameters
    ----------
    correlation, correlation_error, correlation_z : float
        Correlation of the bits of a jot in successive frames, pooled over all jots; its standard
        error; and their ratio. Afterpulsing and memory of the electronics raise it.
    homogeneity_z : float
        Excess of the differences between blocks of frames over those expected in random order, in
        standard errors. Changing light, motion, and temperature raise it.
    map : ndarray of float32, shape (H, W)
        The same excess for each jot, in standard deviations.
    """

    correlation: float
    correlation_error: float
    correlation_z: float
    homogeneity_z: float
    map: npt.NDArray[np.float32] = dataclasses.field(repr=False)

    @property
    def _numbers(self) -> tuple[float, ...]:
        """All values but the map."""
        return (
            self.correlation,
            self.correlation_error,
            self.correlation_z,
            self.homogeneity_z,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Steadiness):
            return NotImplemented
        return self._numbers == other._numbers and np.array_equal(self.map, other.map)

    def __hash__(self) -> int:
        return hash(self._numbers)


def steadiness(
    bits: Bits,
    mask: npt.NDArray[np.bool_] | None = None,
    *,
    threads: int | None = None,
    progress: Progress = False,
) -> Steadiness | None:
    """Return the results of tests for correlated frames and for change over time.

    Both tests compare a statistic with its distribution for frames in random order. Its mean and
    variance, conditional on the count of the jot, are known exactly, so neither the scene nor the
    dark counts need to be known. Jots are assumed to be independent. So flicker that all jots share
    is detected, too, but with too large a z. The memory is constant.

    Parameters
    ----------
    bits : Bits, shape (T, H, W)
        At least 8 frames. Fewer than 256 are divided into up to 19 blocks of equal length, and 256
        or more into 16. The remaining frames are ignored.
    mask : ndarray of bool, shape (H, W), optional
        True marks jots to ignore.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

    Returns
    -------
    Steadiness or None
        None for fewer than 8 frames, or if the bits of no jot change.

    Raises
    ------
    ValueError
        When the mask is not bool, or has another shape.

    Notes
    -----
    A jot with L ones in m frames and C pairs of ones in successive frames has L - C runs of ones.
    In random order, the number of runs is hypergeometric. Pairs are counted inside each block, so
    slow change does not count as correlation. The counts of the blocks form the χ² of a 2 x B
    table with fixed margins. Its exact variance is from Dawson (Biometrika 41, 1954).

    Examples
    --------
    >>> frames = np.random.default_rng(0).random((200, 16, 16)) < 0.3
    >>> found = steadiness(jl.Bits.from_array(frames))
    >>> abs(found.correlation_z) < 4, abs(found.homogeneity_z) < 4
    (True, True)
    >>> twice = np.repeat(frames, 2, axis=0)  # each frame occurs twice
    >>> round(steadiness(jl.Bits.from_array(twice)).correlation, 1)
    0.5
    """
    check_mask(mask, bits.shape[1:])
    check_progress(progress)
    size = block_frames(len(bits))
    if size is None:
        return None
    blocks = len(bits) // size
    counts, pairs = [], []
    with shown_progress(progress, "comparing frames") as update:
        for index in range(blocks):
            block = bits[index * size : (index + 1) * size]
            counts.append(block.counts(1, threads=threads))
            pairs.append(_successive_ones(block).counts(1, threads=threads))
            update((index + 1) / blocks)
    return steadiness_of_blocks(counts, pairs, size, mask)


def block_frames(frames: int) -> int | None:
    """Return the number of frames of each of the blocks that are compared.

    It is None if there are too few frames.

    Examples
    --------
    >>> block_frames(1000), block_frames(7)
    (62, None)
    """
    return None if frames < _MIN_FRAMES else frames // min(BLOCKS, frames // 4)


def steadiness_of_blocks(
    counts: Iterable[npt.NDArray[np.int32]],
    pairs: Iterable[npt.NDArray[np.int32]],
    size: int,
    mask: npt.NDArray[np.bool_] | None = None,
) -> Steadiness | None:
    """Return the results of the tests from the counts of each block of frames.

    Parameters
    ----------
    counts, pairs : iterable of ndarray of int32, shape (H, W)
        For each block, the number of ones of each jot, and the number of ones that are followed by
        a one in the same block.
    size : int
        Number of frames of a block.
    mask : ndarray of bool, shape (H, W), optional
        True marks jots to ignore.
    """
    blocks = 0
    for number, each in zip(counts, pairs, strict=True):
        if not blocks:
            ones = np.zeros(number.shape, np.int64)
            squares, excess, variance, scale = (np.zeros(number.shape) for _ in range(4))
        blocks += 1
        ones += number
        squares += number.astype(np.float64) ** 2
        for total, part in zip(
            (excess, variance, scale), _correlation(number, each, size), strict=True
        ):
            total += part
    check_mask(mask, ones.shape)
    good = np.ones(ones.shape, bool) if mask is None else ~mask
    map_, spread = _homogeneity(ones, squares, blocks, size)
    if not (spread[good] > 0).any() or not (variance[good] > 0).any():
        return None
    homogeneity = map_[good].sum() / math.sqrt((spread[good] ** 2).sum())
    total, error = excess[good].sum(), math.sqrt(variance[good].sum())
    full = float(scale[good].sum())
    deviations = np.divide(map_, spread, out=np.zeros_like(map_), where=spread > 0)
    return Steadiness(
        correlation=float(total / full),
        correlation_error=error / full,
        correlation_z=float(total / error),
        homogeneity_z=float(homogeneity),
        map=deviations.astype(np.float32),
    )


def _successive_ones(bits: Bits) -> Bits:
    """Return the bits that are 1 in a frame and in the next one, computed on reading."""
    packed = bits.packed

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        part = read_frames(packed, start, stop + 1)
        return np.asarray(part[:-1] & part[1:])

    return Bits(Frames((len(bits) - 1, *packed.shape[1:]), read), bits.width)


def _correlation(
    ones: npt.NDArray[np.int32], pairs: npt.NDArray[np.int32], frames: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the excess of pairs over their mean in random order, its variance, and m p (1 - p)."""
    n, L = float(frames), ones.astype(np.float64)  # noqa: N806
    zeros = n - L
    excess = pairs - L * (L - 1) / n
    variance = L * (L - 1) * (zeros + 1) * zeros / (n**2 * (n - 1))
    return excess, variance, L * zeros / n


def _homogeneity(
    ones: npt.NDArray[np.int64], squares: npt.NDArray[np.float64], blocks: int, size: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return χ² of each jot minus its mean in random order, and its standard deviation."""
    n, L = float(blocks * size), ones.astype(np.float64)  # noqa: N806
    zeros = n - L
    both = L * zeros
    varies = (both > 0) & (n > 3)
    both = np.where(varies, both, 1)
    chi2 = (squares - L**2 / blocks) * n**2 / (size * both)
    mean = n * (blocks - 1) / (n - 1)
    rows = (n - 2) / (n - 1) - (n**2 / both - 4) / (n - 2)
    columns = (blocks - 1) * (n - blocks) / (n - 1)
    variance = np.where(varies, 2 * n / (n - 3) * rows * columns, 0)
    return np.where(varies, chi2 - mean, 0), np.sqrt(np.maximum(variance, 0))


def warn_about_unsteady_frames(name: str, steady: Steadiness | None, rate: float) -> None:
    """Warn about correlation, and change over time, with a p-value below the rate.

    Parameters
    ----------
    name : str
        Name of the capture.
    steady : Steadiness or None
        Results of the tests, or None if the frames are not known.
    rate : float
        The largest p-value.
    """
    from scipy.stats import norm

    if steady is None:
        return
    if abs(steady.correlation_z) > norm.isf(rate / 2):
        warn(
            f"{name}: successive frames are correlated, {steady.correlation:.2g} "
            f"(z = {steady.correlation_z:.1f}), for example by afterpulsing; the likelihood "
            "assumes independent frames"
        )
    if steady.homogeneity_z > norm.isf(rate):
        warn(
            f"{name}: counts change over time (z = {steady.homogeneity_z:.1f}), for example by "
            "motion, flicker, or temperature; the calibration assumes constant rates"
        )
