"""By how much a motion explains the bits better than a scene that stands still."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.motion.counts.equivalent import equivalent_sums, expected_probability
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.scoring import Template, make_template
from jotlight.motion.displacements.track import Counted
from jotlight.squares import repeat_squares

Make = Callable[[Sums, int | None], Template]

_STEP = 4
"""Side of the squares of positions for which it is tested whether they are seen."""


def likelihood_gain(paths: Counted, make: Make = make_template) -> float:
    """Return the gain of the log-likelihood over that of a scene that stands still, in nats.

    Each block is compared with the template of other blocks: of those with odd numbers if its own
    number is even, and the reverse. A motion that fits nothing but noise gains nothing.

    Bits that leave the view under the motion are left out of both: they may be easier or harder to
    explain than the others. For the same reason, likelihoods are relative to that of the mean p₀.
    If the scene stands still, a position has a share of bits that stay in view in each half of the
    blocks.

    Parameters
    ----------
    paths : Counted
        The paths of all pixels.
    make : callable
        The function that makes a template of sums:
        :func:`jotlight.motion.displacements.scoring.make_template`, or a faster one.
    """
    blocks = paths.blocks
    own, unmoved, seen = [], [], []
    for half in (0, 1):
        every_second = range(half, len(blocks.centers), 2)
        own.append(Sums.total(map(paths.sums, every_second), blocks.threads, blocks.size))
        frames = [blocks.frames(block) for block in every_second]
        unmoved.append(blocks.count_unmoved(frames))
        in_view = np.zeros(blocks.size, np.float32)[::_STEP, ::_STEP]
        for block, counted in zip(every_second, frames, strict=True):
            lit = np.float32(blocks.burst.number_lit(counted))
            in_view += lit * _positions_seen(paths, block)
        seen.append(in_view)
    every = equivalent_sums(unmoved[0] + unmoved[1])
    mean = float(np.clip(every.ones.sum() / max(float(every.trials.sum()), 1), 1e-9, 1 - 1e-9))
    gain, kept = _log_likelihood(own, None, mean, make, blocks.threads)
    shares = [
        _at_pixels(part / np.float32(max(sums.frames, 1)), blocks.size)
        for part, sums in zip(seen, unmoved, strict=True)
    ]
    loss, visible = _log_likelihood(unmoved, shares, mean, make, blocks.threads)
    return gain - loss * (kept / max(visible, 1.0))


def _log_likelihood(
    halves: list[Sums], shares: list[Image] | None, mean: float, make: Make, threads: int | None
) -> tuple[float, float]:
    """Return the log-likelihood of each half under the template of the other, and the trials.

    It is Σ s [N log p/p₀ + (D - N) log (1 - p)/(1 - p₀)], with a share s of the bits of each pixel.
    """
    total, trials = 0.0, 0.0
    for index, (half, other) in enumerate(zip(halves, reversed(halves), strict=True)):
        p = expected_probability(half, make(other, threads).probability)
        p_0 = expected_probability(half, np.full_like(p, mean))
        ones, number = (each.astype(np.float32) for each in (half.ones, half.trials))
        terms = ones * np.log(p / p_0)
        terms += (number - ones) * np.log((1 - p) / (1 - p_0))
        if shares:
            terms *= shares[index]
            number *= shares[index]
        total += float(terms.sum(dtype=np.float64))
        trials += float(number.sum(dtype=np.float64))
    return total, trials


def _positions_seen(paths: Counted, block: int) -> npt.NDArray[np.bool_]:
    """Return whether some pixel counts a position in a block, in squares of four rows and columns.

    It is that of the center of a square. A corner would be nearer to two borders of the image than
    its square, and bits that leave the view there would seem to be harder to explain.
    """
    height, width = paths.blocks.size
    # Motions are so smooth that the displacement of the position is nearly that of the pixel.
    displaced = paths.displacements(block, _STEP)
    rows = _centers(height)[:, None] - displaced[0]
    columns = _centers(width) - displaced[1]
    inside = (abs(rows - (height - 1) / 2) < height / 2) & (
        abs(columns - (width - 1) / 2) < width / 2
    )
    return np.asarray(inside)


def _centers(length: int) -> npt.NDArray[np.float32]:
    """Return the centers of the squares along an axis, and the end where a square exceeds it.

    Examples
    --------
    >>> _centers(10).tolist()
    [1.5, 5.5, 8.5]
    """
    starts = np.arange(0, length, _STEP)
    return np.asarray((starts + np.minimum(starts + _STEP, length) - 1) / 2, np.float32)


def _at_pixels(samples: Image, size: tuple[int, int]) -> Image:
    """Return samples of every fourth row and column at all pixels, (H, W)."""
    return repeat_squares(samples, _STEP, size)
