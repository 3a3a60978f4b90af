"""How much better one motion explains the bits than another one."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.scoring import make_template
from jotlight.motion.track import Counted

Logarithms = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""log p and log(1 - p) of each pixel."""


def likelihood_gain(moving: Counted, still: Counted) -> float:
    """Return the gain of the log-likelihood over that of a scene that stands still, in nats.

    Bits that leave the view under the motion are left out of both: they may be easier or harder to
    explain than the others.
    """
    likelihood, trials = 0.0, 0.0
    unmoved, unmoved_trials = 0.0, 0.0
    number = len(moving.blocks.centers)
    own_logarithms, still_logarithms = (_log_probabilities(each) for each in (moving, still))
    for block in range(number):
        own, others = moving.sums(block), still.sums(block)
        seen = _positions_seen(moving, block)
        likelihood += _log_likelihood(own, own_logarithms)
        trials += float(own.trials.sum())
        unmoved += _log_likelihood(others, still_logarithms, seen)
        unmoved_trials += float(others.trials[seen].sum())
    return likelihood - unmoved * trials / max(unmoved_trials, 1.0)


def _log_probabilities(motion: Counted) -> Logarithms:
    """Return log p and log(1 - p) of the template of the sums of all blocks."""
    total = Sums.zeros(motion.blocks.size)
    for block in range(len(motion.blocks.centers)):
        total = total + motion.sums(block)
    p = make_template(total, motion.blocks.threads).probability.astype(np.float64)
    return np.log(p), np.log1p(-p)


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
