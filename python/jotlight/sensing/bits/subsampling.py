"""Random subsets of the bits of each pixel."""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Integers
from jotlight.seeds import random_generator

_MAX_PART = 10**9
"""NumPy draws from fewer ones and fewer zeros than this."""


def subsample_counts(
    ones: npt.ArrayLike,
    trials: npt.ArrayLike,
    subset: npt.ArrayLike,
    rng: int | np.random.Generator,
) -> Integers:
    """Return the number of ones in a random subset of each pixel's bits.

    The bits of a pixel are exchangeable, so the number has the hypergeometric distribution.

    Parameters
    ----------
    ones, trials : array_like of int, shape (H, W)
        L, the ones among the n bits of each pixel, and n.
    subset : array_like of int, shape (H, W)
        Number of bits to draw from each pixel without replacement, at most n.
    rng : int or numpy.random.Generator
        Seed, or source of randomness.

    Returns
    -------
    ndarray of int64, shape (H, W)

    Raises
    ------
    ValueError
        When a subset is larger than its n, or L is above n.

    Examples
    --------
    >>> subsample_counts([[0, 3, 8]], [[8, 8, 8]], [[5, 8, 5]], rng=0).tolist()
    [[0, 3, 5]]
    """
    ones = np.asarray(ones, np.int64)
    zeros = np.asarray(trials, np.int64) - ones
    ones, zeros, number = np.broadcast_arrays(ones, zeros, np.asarray(subset, np.int64))
    return _draw(ones, zeros, number, random_generator(rng))


def draw_share(
    ones: npt.NDArray[np.integer], trials: Array, share: float, rng: np.random.Generator
) -> tuple[Integers, Array]:
    """Return the ones and the number of a random share of each pixel's bits.

    A fraction of a trial is a zero that counts less. It is drawn like the other bits: if it always
    stayed behind, the drawn bits would have too few zeros.

    Parameters
    ----------
    ones : ndarray of int, shape (H, W)
        L, the ones among the n bits of each pixel.
    trials : ndarray of float64, shape (H, W)
        n, which may be a real number of L or more.
    share : float
        The share of the bits to draw, in [0, 1].
    rng : numpy.random.Generator
        Source of randomness.

    Examples
    --------
    >>> ones, trials = np.full((1, 4), 3), np.array([[5.0, 5.0, 5.5, 5.5]])
    >>> drawn = draw_share(ones, trials, 0.5, np.random.default_rng(0))
    >>> drawn[0].tolist(), drawn[1].tolist()
    ([[2, 1, 2, 1]], [[3.0, 2.0, 2.5, 2.0]])
    """
    whole = ones + np.floor(trials - ones).astype(np.int64)
    # The fractional part of the number of drawn bits becomes one more bit in some of the pixels.
    number = np.minimum(np.floor(share * whole + rng.random(whole.shape)).astype(np.int64), whole)
    drawn = subsample_counts(ones, whole, number, rng)
    fraction = trials - whole
    if not fraction.any():
        return drawn, number.astype(np.float64)
    return drawn, number + np.where(rng.random(whole.shape) < share, fraction, 0.0)


def _draw(ones: Integers, zeros: Integers, subset: Integers, rng: np.random.Generator) -> Integers:
    """Return hypergeometric numbers of ones, also for more bits than NumPy takes."""
    is_large = np.maximum(ones, zeros) >= _MAX_PART
    if not is_large.any():
        return rng.hypergeometric(ones, zeros, subset)
    if ((ones < 0) | (zeros < 0) | (subset > ones + zeros)).any():
        raise ValueError("ones, subset: expected at most the number of bits of each pixel")
    drawn = np.zeros_like(ones)
    drawn[~is_large] = rng.hypergeometric(ones[~is_large], zeros[~is_large], subset[~is_large])
    is_large &= subset > 0
    if is_large.any():
        drawn[is_large] = _draw_large(ones[is_large], zeros[is_large], subset[is_large], rng)
    return drawn


def _draw_large(
    ones: Integers, zeros: Integers, subset: Integers, rng: np.random.Generator
) -> Integers:
    """Return hypergeometric numbers of ones from binomial ones.

    Bits that are taken independently of each other are a random subset, whatever their number. The
    few in excess are removed at random, and the few that lack are drawn from the rest.
    """
    share = subset / (ones + zeros)
    own_ones, own_zeros = rng.binomial(ones, share), rng.binomial(zeros, share)
    excess = own_ones + own_zeros - subset
    others = _draw(
        np.where(excess > 0, own_ones, ones - own_ones),
        np.where(excess > 0, own_zeros, zeros - own_zeros),
        np.abs(excess),
        rng,
    )
    return np.asarray(own_ones - np.sign(excess) * others)
