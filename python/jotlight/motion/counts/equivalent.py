"""Equivalent counts: those that the median jot would have instead of the jots that were seen.

The ones N of a pixel with D bits are expected to be D P(q, η̄ s + d̄), with the mean efficiency η̄
and the mean dark counts d̄ of the jots that its scene point has passed. The light s follows from
the template: the median jot reports 1 with probability p. Equivalent counts N', D' have the same
derivative of the log-likelihood with respect to p, and the same information about it. So functions
that compare counts with p need not know the jots.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.motion.counts.jots import Jots, SeenJots, inverse_response, response
from jotlight.motion.counts.sums import Sums
from jotlight.motion.tiles import add_squares
from jotlight.squares import repeat_squares

MIN_PROBABILITY = 1e-4
"""Smallest distance of a probability from 0 and from 1."""

_LARGEST_COUNT = 2.0**20
"""Largest count of counts that are rounded to whole numbers."""

_SQUARE, _BOX = 4, 3
"""Side of the squares over which counts are added for an estimate, and number of squares of a box
over which these are averaged."""


def equivalent_sums(sums: Sums, probability: Image | None = None) -> Sums:
    """Return sums with equivalent counts, or the same sums if all jots are alike.

    With p_k, the probability of a one at the jots that were seen, and its derivative c with respect
    to p, they are D' = D c² p(1 - p)/[p_k(1 - p_k)] and N' = D' p + (N - D p_k) c
    p(1 - p)/[p_k(1 - p_k)]. They are real numbers, and N' may be negative.

    Parameters
    ----------
    sums : Sums
        The sums.
    probability : ndarray of float32, shape (H, W), optional
        p: the probability that the median jot reports 1. Default: an estimate from the sums.
    """
    if sums.jots is None:
        return sums
    if probability is None:
        probability = estimate_probability(sums)
    expected, slope = sums.jots.response(sums.trials, probability)
    expected = clip_probability(expected)
    weight = slope * probability * (1 - probability) / (expected * (1 - expected))
    trials = sums.trials * (weight * slope)
    ones = trials * probability + (sums.ones - sums.trials * expected) * weight
    return dataclasses.replace(
        sums, ones=ones.astype(np.float32), trials=trials.astype(np.float32), jots=None
    )


def expected_probability(sums: Sums, probability: Image) -> Image:
    """Return the probability of a one at each pixel of sums, if that of the median jot is p."""
    if sums.jots is None:
        return probability
    return clip_probability(sums.jots.response(sums.trials, probability)[0])


def estimate_probability(sums: Sums) -> Image:
    """Return a coarse estimate of the probability that the median jot reports 1, (H, W)."""
    if sums.jots is None:
        raise ValueError("sums: expected those of jots that differ")
    parts = sums.ones, sums.trials, *sums.jots.sums
    ones, trials, *jots = (_box(add_squares(each, _SQUARE)) for each in parts)
    squares = _estimate(ones, trials, SeenJots(sums.jots.jots, np.stack(jots)))
    height, width = sums.ones.shape
    return np.ascontiguousarray(repeat_squares(squares, _SQUARE, (height, width)))


def flatten_counts(
    counts: npt.NDArray[np.int32], trials: int | npt.NDArray[np.integer], side: int, jots: Jots
) -> npt.NDArray[np.int32]:
    """Return counts of blocks at rest (n, h, w) without the pattern of the jots.

    They are proportional to equivalent counts, and so large that rounding does not matter. Squares
    without counted jots have the counts of their surroundings.

    Parameters
    ----------
    counts : ndarray of int32, shape (n, h, w)
        Number of ones in squares of jots.
    trials : int or ndarray of int, shape (n,)
        Number of readings of each jot in a block.
    side : int
        Side of a square.
    jots : Jots
        The jots.
    """
    height, width = (side * length for length in counts.shape[1:])
    *maps, number = (add_squares(values, side) for values in jots.maps[:, :height, :width])
    seen = SeenJots(jots, np.stack(maps))
    trials = np.broadcast_to(trials, len(counts))
    ones = counts.sum(axis=0, dtype=np.float32) / np.float32(max(1, trials.sum()))
    near = SeenJots(jots, np.stack([_box(values) for values in maps]))
    probability = _estimate(_box(ones), _box(number), near)
    expected, slope = seen.response(number, probability)
    gain = side**2 / np.maximum(number, 1) / slope * (number > 0)
    offset = side**2 * probability - gain * number * expected
    equivalent = counts * gain + trials[:, None, None] * offset
    scale = _LARGEST_COUNT / max(float(abs(equivalent).max()), 1e-9)
    return np.rint(scale * equivalent).astype(np.int32)


def _estimate(ones: Image, trials: Image, seen: SeenJots) -> Image:
    """Return the probability that the median jot reports 1, from sums over bits.

    Where there are no bits, it is that of the mean light.
    """
    # The filter leaves errors of rounding.
    known = trials > 1e-6
    trials = np.where(known, trials, 0)
    efficiency, dark_counts = seen.mean(trials)
    threshold, reference = seen.jots.threshold, seen.jots.reference
    fraction = clip_probability(ones / np.where(known, trials, 1))
    light = np.maximum(inverse_response(threshold, fraction) - dark_counts, 0) / efficiency
    if known.any():
        light = np.where(known, light, light[known].mean(dtype=np.float32))
    own = (reference.efficiency * light + reference.dark_counts).astype(np.float32)
    return clip_probability(response(threshold, own)[0])


def _box(values: npt.NDArray[np.generic]) -> Image:
    """Return the means over boxes."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(values.astype(np.float32), _BOX, mode="nearest"))


def clip_probability(probability: npt.NDArray[np.floating]) -> Image:
    """Return probabilities that are not too near 0 and 1, so that their logarithms are finite."""
    low, high = np.float32(MIN_PROBABILITY), np.float32(1 - MIN_PROBABILITY)
    return np.asarray(np.clip(probability, low, high), np.float32)
