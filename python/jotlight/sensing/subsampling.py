"""Random subsets of the bits of each pixel."""

import numpy as np
import numpy.typing as npt

LongCounts = npt.NDArray[np.int64]
"""Numbers of ones or of bits, (H, W)."""


def subsample_counts(
    ones: npt.ArrayLike,
    trials: npt.ArrayLike,
    subset: npt.ArrayLike,
    rng: int | np.random.Generator,
) -> LongCounts:
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
    return np.random.default_rng(rng).hypergeometric(ones, zeros, np.asarray(subset, np.int64))
