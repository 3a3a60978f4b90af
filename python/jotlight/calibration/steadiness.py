"""Whether a capture's frames are independent and alike, as the likelihood takes them to be."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames

BLOCKS = 16
"""Blocks of frames whose counts are compared."""

_LEAST_FRAMES = 8

Counts = npt.NDArray[np.int64]


@dataclasses.dataclass(frozen=True)
class Steadiness:
    """What the single frames of a capture tell of themselves.

    Parameters
    ----------
    correlation, correlation_error, correlation_z : float
        The correlation of a jot's bits in successive frames, pooled over all jots, its standard
        error, and how many of these errors it is from 0. Afterpulsing and memory of the
        electronics raise it.
    homogeneity_z : float
        By how many standard errors counts differ more between blocks of frames than those of
        frames in random order do: light that changes, motion, temperature.
    map : ndarray of float32, shape (H, W)
        Of each jot, by how many standard deviations its counts differ more between the blocks.
    """

    correlation: float
    correlation_error: float
    correlation_z: float
    homogeneity_z: float
    map: npt.NDArray[np.float32] = dataclasses.field(repr=False)


def steadiness(
    bits: Bits,
    mask: npt.NDArray[np.bool_] | None = None,
    *,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Steadiness | None:
    """Look for correlated frames and for change over time, in constant memory.

    Both figures are compared with what they would be were the frames of each jot in random order:
    its mean and variance given the jot's own count are known exactly, so that neither the scene
    nor dark counts have to be. Jots are taken to be independent of each other; flicker of all of
    them together shows as well, though with z too large.

    Parameters
    ----------
    bits : Bits, shape (T, H, W)
        At least 8 frames; those that do not fill the last of 16 blocks are left out.
    mask : ndarray of bool, shape (H, W), optional
        True marks jots that do not count.
    threads : int, optional
        Threads to use. Default: all.
    progress : callable, optional
        Called now and then with the share that is done.

    Returns
    -------
    Steadiness or None
        None for fewer than 8 frames, or where no jot ever changes.

    Notes
    -----
    With L ones in m frames a jot has L - C runs of ones, C being the pairs of ones in successive
    frames; in random order the number of runs is hypergeometric. Pairs are counted inside of each
    block, so that slow change does not pass for correlation. The blocks' counts make the χ² of
    a 2 x B table with given margins, whose exact variance is Dawson's (Biometrika 41, 1954).

    Examples
    --------
    >>> frames = np.random.default_rng(0).random((200, 16, 16)) < 0.3
    >>> found = steadiness(Bits.from_array(frames))
    >>> abs(found.correlation_z) < 4, abs(found.homogeneity_z) < 4
    (True, True)
    >>> twice = np.repeat(frames, 2, axis=0)  # each frame comes two times
    >>> round(steadiness(Bits.from_array(twice)).correlation, 1)
    0.5
    """
    frames = len(bits)
    if frames < _LEAST_FRAMES:
        return None
    blocks = min(BLOCKS, frames // 4)
    size = frames // blocks
    shape = bits.shape[1:]
    ones = np.zeros(shape, np.int64)
    squares, excess, variance, whole = (np.zeros(shape) for _ in range(4))
    for index in range(blocks):
        block = bits[index * size : (index + 1) * size]
        number = block.counts(1, threads=threads)
        pairs = _in_succession(block).counts(1, threads=threads)
        ones += number
        squares += number.astype(np.float64) ** 2
        for total, part in zip(
            (excess, variance, whole), _correlation(number, pairs, size), strict=True
        ):
            total += part
        if progress:
            progress((index + 1) / blocks)
    good = np.ones(shape, bool) if mask is None else ~mask
    map_, spread = _homogeneity(ones, squares, blocks, size)
    if not (spread[good] > 0).any() or not (variance[good] > 0).any():
        return None
    homogeneity = map_[good].sum() / math.sqrt((spread[good] ** 2).sum())
    total, error = excess[good].sum(), math.sqrt(variance[good].sum())
    full = float(whole[good].sum())
    deviations = np.divide(map_, spread, out=np.zeros_like(map_), where=spread > 0)
    return Steadiness(
        correlation=float(total / full),
        correlation_error=error / full,
        correlation_z=float(total / error),
        homogeneity_z=float(homogeneity),
        map=deviations.astype(np.float32),
    )


def _in_succession(bits: Bits) -> Bits:
    """The bits that are one in a frame and in the next, made as they are read."""
    packed = bits.packed

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        part = packed[start : stop + 1]
        whole = part.read(0, len(part)) if isinstance(part, Frames) else part
        return np.asarray(whole[:-1] & whole[1:])

    return Bits(Frames((len(bits) - 1, *packed.shape[1:]), read), bits.width)


def _correlation(
    ones: npt.NDArray[np.int32], pairs: npt.NDArray[np.int32], frames: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Pairs above those of random order, their variance there, and m p (1 - p)."""
    n, L = float(frames), ones.astype(np.float64)  # noqa: N806
    zeros = n - L
    excess = pairs - L * (L - 1) / n
    variance = L * (L - 1) * (zeros + 1) * zeros / (n**2 * (n - 1))
    return excess, variance, L * zeros / n


def _homogeneity(
    ones: Counts, squares: npt.NDArray[np.float64], blocks: int, size: int
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """χ² of each jot less its mean, and the standard deviation of it, in random order."""
    n, L = float(blocks * size), ones.astype(np.float64)  # noqa: N806
    zeros = n - L
    both = L * zeros
    lively = (both > 0) & (n > 3)
    both = np.where(lively, both, 1)
    chi2 = (squares - L**2 / blocks) * n**2 / (size * both)
    mean = n * (blocks - 1) / (n - 1)
    rows = (n - 2) / (n - 1) - (n**2 / both - 4) / (n - 2)
    columns = (blocks - 1) * (n - blocks) / (n - 1)
    variance = np.where(lively, 2 * n / (n - 3) * rows * columns, 0)
    return np.where(lively, chi2 - mean, 0), np.sqrt(np.maximum(variance, 0))
