"""How much better one motion explains the bits than another one."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.scoring import make_template
from jotlight.motion.track import Counted

Logarithms = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""log p/p₀ and log (1 - p)/(1 - p₀) of each pixel, with the mean p₀ of all bits."""


def likelihood_gain(moving: Counted, still: Counted) -> float:
    """Return the gain of the log-likelihood over that of a scene that stands still, in nats.

    Each block is compared with the template of other blocks: of those with odd numbers if its own
    number is even, and the reverse. A motion that fits nothing but noise gains nothing.

    Bits that leave the view under the motion are left out of both: they may be easier or harder to
    explain than the others. For the same reason, likelihoods are relative to that of p₀.
    """
    gain, trials = 0.0, 0.0
    unmoved, unmoved_trials = 0.0, 0.0
    halves = [_of_halves(each) for each in (moving, still)]
    every = Sums.total(halves[1])
    mean = float(np.clip(every.ones.sum() / max(int(every.trials.sum()), 1), 1e-9, 1 - 1e-9))
    threads = moving.blocks.threads
    own_logarithms, still_logarithms = (_log_ratios(each, mean, threads) for each in halves)
    for block in range(len(moving.blocks.centers)):
        own, others = moving.sums(block), still.sums(block)
        seen = _positions_seen(moving, block)
        gain += _log_likelihood(own, own_logarithms[block % 2])
        trials += float(own.trials.sum())
        unmoved += _log_likelihood(others, still_logarithms[block % 2], seen)
        unmoved_trials += float(others.trials[seen].sum())
    return gain - unmoved * trials / max(unmoved_trials, 1.0)


def _of_halves(motion: Counted) -> list[Sums]:
    """Return the sums of the blocks with odd numbers, and of those with even numbers."""
    halves = [Sums.zeros(motion.blocks.size) for _ in range(2)]
    for block in range(len(motion.blocks.centers)):
        other = 1 - block % 2
        halves[other] = halves[other] + motion.sums(block)
    return halves


def _log_ratios(halves: list[Sums], mean: float, threads: int | None) -> list[Logarithms]:
    """Return the logarithms for blocks with even numbers, and for those with odd numbers."""
    logarithms = []
    for half in halves:
        p = make_template(half, threads).probability.astype(np.float64)
        logarithms.append((np.log(p / mean), np.log((1 - p) / (1 - mean))))
    return logarithms


def _log_likelihood(
    sums: Sums, logarithms: Logarithms, seen: npt.NDArray[np.bool_] | None = None
) -> float:
    ones, zeros = logarithms
    terms = sums.ones * ones + (sums.trials - sums.ones) * zeros
    return float(terms.sum() if seen is None else terms[seen].sum())


def _positions_seen(motion: Counted, block: int) -> npt.NDArray[np.bool_]:
    """Return the positions in a block that some pixel counts, (H, W)."""
    size = motion.blocks.size
    # Motions are so smooth that the displacement of the position is nearly that of the pixel.
    rows, columns = np.indices(size) - np.rint(motion.displacements(block))
    inside = (rows >= 0) & (rows < size[0]) & (columns >= 0) & (columns < size[1])
    return np.asarray(inside)
