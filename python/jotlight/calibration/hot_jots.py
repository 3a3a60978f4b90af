"""Hot jots in a capture of a scene, for sensors without a dark capture."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_counts, whole_number
from jotlight.interrupts import interruptible
from jotlight.sensing.bits import Bits
from jotlight.sensing.response import detection_probability, inverse_detection_probability

FALSE_POSITIVE_RATE = 1e-6
"""Default maximum probability that a jot is called hot which is not."""

EXCESS = 4.0
"""Multiple of the light of its neighbors that a jot does not have without being hot.

A lens spreads a star over several jots. With a Gaussian spread of σ = 0.65 jots or more (a full
width of 1.5), two of the neighbors of each jot have a quarter of its light or more.
"""

Array = npt.NDArray[np.float64]


def find_hot_jots(
    data: Bits | npt.ArrayLike,
    *,
    trials: int | None = None,
    threshold: int = 1,
    mask: npt.NDArray[np.bool_] | None = None,
    false_positive_rate: float = FALSE_POSITIVE_RATE,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> npt.NDArray[np.bool_]:
    """Return the jots that detect far more than their neighborhood explains.

    A jot is called hot if its rate of detections is more than 4 times that of its neighbors, in
    two respects. First, it exceeds 4 times the mean of its 8 neighbors, with statistical certainty.
    Second, its measured rate exceeds 4 times that of the second brightest neighbor, which spares
    thin lines and stars. So hot jots in bright parts of the scene, and clusters of three or more of
    them, are not found: a dark capture and :func:`jotlight.calibrate` find them all. Light that
    falls on a single jot, and the sharp end of a line that is one jot wide, look hot.

    Parameters
    ----------
    data : Bits (T, H, W), or array_like of int, shape (H, W)
        Bits, or counts of single jots. Bits of color (T, H, W, C) are counted for each channel; a
        jot is hot if it is in one of them.
    trials : int, optional
        Number of binary readings behind each count. Required for counts.
    threshold : int
        q: the number of photons that make a jot report 1.
    mask : ndarray of bool, shape (H, W), optional
        True marks dead jots, which are not compared.
    false_positive_rate : float
        Maximum probability that an ordinary jot is called hot, whose rate is at most 4 times the
        mean of its neighbors.
    threads : int, optional
        Number of threads. Default: all.
    progress : callable, optional
        Called repeatedly with the completed fraction, 0 to 1.

    Returns
    -------
    ndarray of bool, shape (H, W)
        True for hot jots. It has the form of the ``mask`` of a :class:`jotlight.Sensor`.

    Raises
    ------
    TypeError, ValueError
        When the data have another shape, or a number is missing or out of range.

    Notes
    -----
    The mean of the neighbors has an upper confidence limit of Clopper and Pearson with half of the
    false-positive rate. The count of the jot then has a binomial tail probability, which must be
    below the other half. Both are exact, whatever the rates of the neighbors are.

    Examples
    --------
    >>> rates = np.full((32, 32), 0.02)
    >>> rates[5, 7] = 0.5
    >>> bits = Bits.from_array(np.random.default_rng(0).random((200, 32, 32)) < rates)
    >>> np.argwhere(find_hot_jots(bits)).tolist()
    [[5, 7]]
    """
    if not 0 < false_positive_rate <= 0.01:
        raise ValueError(
            f"false_positive_rate: expected a number in (0, 0.01], got {false_positive_rate!r}"
        )
    if isinstance(data, Bits):
        counts, number = data.counts(1, threads=threads, progress=progress), len(data)
    else:
        if trials is None:
            raise TypeError("trials: expected the number of binary readings behind each count")
        counts, number = as_counts(data), whole_number("trials", trials, 1)
    if counts.max() > number:
        raise ValueError(f"counts: expected at most {number} trials, got {counts.max()}")
    if mask is not None and mask.shape != counts.shape[:2]:
        raise ValueError(f"mask: expected shape {counts.shape[:2]}, got {mask.shape}")
    valid = np.ones(counts.shape[:2], bool) if mask is None else ~mask
    hot = np.zeros(counts.shape[:2], bool)
    for channel in np.atleast_3d(counts).transpose(2, 0, 1):
        hot |= _find(channel, valid, number, threshold, false_positive_rate)
    return hot


@interruptible
def _find(
    counts: npt.NDArray[np.int32],
    valid: npt.NDArray[np.bool_],
    trials: int,
    threshold: int,
    rate: float,
) -> npt.NDArray[np.bool_]:
    """Return the hot jots of one channel."""
    from scipy.special import bdtrc, betaincinv

    padded = np.pad(np.where(valid, counts, -1), 1, constant_values=-1)
    neighbors = _neighbors(padded)
    total = np.maximum(neighbors, 0).sum(0).astype(np.float64)
    readings = (neighbors >= 0).sum(0) * float(trials)
    if min(counts.shape) > 1:
        # A line that ends at the edge of the image continues outside.
        neighbors = _neighbors(np.pad(padded[1:-1, 1:-1], 1, mode="reflect"))
    second = np.partition(neighbors, -2, axis=0)[-2]
    # Few jots can be hot. The exact test takes longer.
    candidates = valid & (counts > second) & (readings > 0)
    light = _light(counts[candidates], trials, threshold)
    brighter = light > EXCESS * _light(np.maximum(second[candidates], 0), trials, threshold)
    candidates[candidates] = brighter
    ones, total, readings = counts[candidates], total[candidates], readings[candidates]
    saturated = total >= readings
    limit = betaincinv(total + 1, np.where(saturated, 1, readings - total), 1 - rate / 2)
    highest = inverse_detection_probability(threshold, limit, 1 - limit)
    explained = np.asarray(detection_probability(threshold, EXCESS * highest))
    tail = bdtrc(ones - 1.0, trials, np.where(saturated, 1.0, explained))
    hot = np.zeros(counts.shape, bool)
    hot[candidates] = tail <= rate / 2
    return hot


def _neighbors(padded: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Return the counts of the 8 neighbors of each jot (8, H, W), from counts (H + 2, W + 2)."""
    height, width = (length - 2 for length in padded.shape)
    places = [(row, column) for row in range(3) for column in range(3) if (row, column) != (1, 1)]
    return np.stack([padded[row : row + height, col : col + width] for row, col in places])


def _light(counts: npt.NDArray[np.int32], trials: int, threshold: int) -> Array:
    """Return the most likely detected photons per frame. A count of all trials is half less."""
    fractions = np.minimum(counts, trials - 0.5) / trials
    return np.asarray(inverse_detection_probability(threshold, fractions, 1 - fractions))
