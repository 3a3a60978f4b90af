"""How much better one motion explains the bits than another one."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.scoring import make_template
from jotlight.motion.tiles import interpolate
from jotlight.motion.track import Track

Logarithms = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]
"""log p and log(1 - p) of each pixel."""


def likelihood_gain(track: Track, still: Track) -> float:
    """Return the gain of the log-likelihood over that of a scene that stands still, in nats.

    Bits that leave the view under the motion are left out of both: they may be easier or harder to
    explain than the others.
    """
    moving, trials = 0.0, 0.0
    unmoved, unmoved_trials = 0.0, 0.0
    sums = [track.sums(block) for block in range(len(track.nodes))]
    still_sums = [still.sums(block) for block in range(len(still.nodes))]
    own_logarithms = _log_probabilities(Sums.total(sums), track)
    still_logarithms = _log_probabilities(Sums.total(still_sums), still)
    for block, (own, others) in enumerate(zip(sums, still_sums, strict=True)):
        seen = _positions_seen(track, block)
        moving += _log_likelihood(own, own_logarithms)
        trials += float(own.trials.sum())
        unmoved += _log_likelihood(others, still_logarithms, seen)
        unmoved_trials += float(others.trials[seen].sum())
    return moving - unmoved * trials / max(unmoved_trials, 1.0)


def gain_between(first: Track, second: Track) -> float:
    """Return the gain of the log-likelihood of the second motion over that of the first, in nats.

    Both motions follow the scene points of the reference time, so their counts at each pixel are
    about the same point.
    """
    totals, means = [], []
    for track in (first, second):
        sums = [track.sums(block) for block in range(len(track.nodes))]
        total = Sums.total(sums)
        ones, zeros = _log_probabilities(total, track)
        likelihood = total.ones * ones + (total.trials - total.ones) * zeros
        means.append(likelihood / np.maximum(total.trials, 1))
        totals.append(total.trials)
    return float((np.minimum(*totals) * (means[1] - means[0])).sum())


def _log_probabilities(total: Sums, track: Track) -> Logarithms:
    """Return log p and log(1 - p) of the template of the sums of all blocks."""
    p = make_template(total, track.blocks.threads).probability.astype(np.float64)
    return np.log(p), np.log1p(-p)


def _log_likelihood(
    sums: Sums, logarithms: Logarithms, seen: npt.NDArray[np.bool_] | None = None
) -> float:
    ones, zeros = logarithms
    terms = sums.ones * ones + (sums.trials - sums.ones) * zeros
    return float(terms.sum() if seen is None else terms[seen].sum())


def _positions_seen(track: Track, block: int) -> npt.NDArray[np.bool_]:
    """Return the positions in a block that some pixel counts, (H, W)."""
    size = track.blocks.size
    # Motions are so smooth that the displacement of the position is nearly that of the pixel.
    rows, columns = np.indices(size) - np.rint(interpolate(track.nodes[block], size))
    inside = (rows >= 0) & (rows < size[0]) & (columns >= 0) & (columns < size[1])
    return np.asarray(inside)
