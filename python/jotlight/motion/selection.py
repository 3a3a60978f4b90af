"""How much better one motion explains the bits than another one."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.scoring import Template, make_template
from jotlight.motion.track import Counted

Make = Callable[[Sums, int | None], Template]


def likelihood_gain(moving: Counted, still: Counted, make: Make = make_template) -> float:
    """Return the gain of the log-likelihood over that of a scene that stands still, in nats.

    Each block is compared with the template of other blocks: of those with odd numbers if its own
    number is even, and the reverse. A motion that fits nothing but noise gains nothing.

    Bits that leave the view under the motion are left out of both: they may be easier or harder to
    explain than the others. For the same reason, likelihoods are relative to that of the mean p₀.

    Parameters
    ----------
    moving, still : Counted
        The motions.
    make : callable
        The function that makes a template of sums: :func:`jotlight.motion.scoring.make_template`,
        or a faster one.
    """
    blocks = moving.blocks
    own, unmoved, seen = ([Sums.zeros(blocks.size) for _ in range(2)] for _ in range(3))
    for block in range(len(blocks.centers)):
        half = block % 2
        at_rest = still.sums(block)
        own[half] += moving.sums(block)
        unmoved[half] += at_rest
        seen[half] += at_rest.masked(_positions_seen(moving, block))
    every = Sums.total(unmoved)
    mean = float(np.clip(every.ones.sum() / max(int(every.trials.sum()), 1), 1e-9, 1 - 1e-9))
    gain = _log_likelihood(own, own, mean, make, blocks.threads)
    loss = _log_likelihood(seen, unmoved, mean, make, blocks.threads)
    kept, visible = (sum(float(each.trials.sum()) for each in part) for part in (own, seen))
    return gain - loss * (kept / max(visible, 1.0))


def _log_likelihood(
    halves: list[Sums], templates: list[Sums], mean: float, make: Make, threads: int | None
) -> float:
    """Return the log-likelihood of each half under the template of the other one.

    It is Σ N log p/p₀ + (D - N) log (1 - p)/(1 - p₀).
    """
    total = 0.0
    for half, other in zip(halves, reversed(templates), strict=True):
        p = make(other, threads).probability.astype(np.float64)
        terms = half.ones * np.log(p / mean)
        terms += (half.trials - half.ones) * np.log((1 - p) / (1 - mean))
        total += float(terms.sum())
    return total


def _positions_seen(motion: Counted, block: int) -> npt.NDArray[np.bool_]:
    """Return the positions in a block that some pixel counts, (H, W)."""
    size = motion.blocks.size
    # Motions are so smooth that the displacement of the position is nearly that of the pixel.
    displaced = np.rint(motion.displacements(block))
    rows = np.arange(size[0], dtype=np.float32)[:, None] - displaced[0]
    columns = np.arange(size[1], dtype=np.float32) - displaced[1]
    inside = (rows >= 0) & (rows < size[0]) & (columns >= 0) & (columns < size[1])
    return np.asarray(inside)
