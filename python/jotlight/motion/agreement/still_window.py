"""A short window without motion, which is better than merged counts where the motion is wrong."""

import math

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.estimators.planning.planned_motion import MIN_FRAMES
from jotlight.motion.agreement.held_out import Fold, central_frames, count_in_place, frames_around
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.track import Paths

_FRACTIONS = (1, 2, 4, 8, 16, 32)
"""The windows have all frames, a half, a quarter, and so on."""

_MIN_LEAD, _ONES = 3.5, 25_000
"""By 3.5 standard deviations, merged counts must predict 25,000 ones better than each window.

If there are fewer ones, the standard deviation is larger in relation to what a motion gains.

In simulations, merged counts that were 0.16 dB worse led by 2.7, and better ones by 4.4 or more.
"""

_HOT = 5.0
"""A jot looks hot if it has more ones than the median of its neighbors by this number of standard
deviations."""

_SMOOTHING = 0.25, 0.5, 0.25
"""Weights of the gains of windows of neighboring lengths."""


def find_window(paths: Paths, total: Sums) -> range | None:
    """Return the frames whose sum without motion is better than the merged counts, or None.

    Of some frames in the middle, every second one is held out, and then the others. A window
    predicts that these frames are alike. The merged counts without them predict each one, moved
    along the motion. So a wrong motion is noticed although single frames have few bits. If the
    merged counts are not clearly better, the window is chosen that predicts the bits best.

    Jots that look hot are not compared: they stay where they are, so any window predicts them.

    If nothing moves, the merged counts are those of all frames in place, without bits that
    disagree. The windows are shorter then, and there is none if there are few frames or few bits.

    Parameters
    ----------
    paths : Paths
        The motion.
    total : Sums
        The merged counts of all frames.
    """
    frames = len(paths.blocks.burst)
    moves = any(track.nodes.any() for track in paths.tracks)
    central, ones_per_frame = central_frames(paths, total), float(total.ones.sum()) / frames
    if not moves and (frames < MIN_FRAMES or len(central) * ones_per_frame < _ONES):
        return None
    fractions = _FRACTIONS if moves else _FRACTIONS[1:]
    lengths = sorted({max(len(central), frames // fraction) for fraction in fractions})
    windows = [frames_around(paths, length) for length in lengths]
    sums = [count_in_place(paths, each) for each in windows]
    compared = ~look_hot(sums[-1])
    folds = [Fold.of(paths, total, central[start::2], compared) for start in (0, 1)]
    gains, errors = np.transpose([_gain_of(each, folds) for each in sums])
    lead = -(_smooth(gains) / np.maximum(errors, 1e-9)).max()
    ones = sum(int(fold.held.ones[compared].sum()) for fold in folds)
    needed = _MIN_LEAD * min(1.0, math.sqrt(ones / _ONES))
    return windows[int(np.argmax(gains))] if lead < needed else None


def look_hot(sums: Sums) -> npt.NDArray[np.bool_]:
    """Return the pixels (H, W) that are much brighter than their neighbors in frames in place.

    In a scene that moves, such sums are blurred, so single bright pixels are hot jots.

    Examples
    --------
    >>> ones = np.full((5, 5), 10)
    >>> ones[2, 3] = 60
    >>> sums = Sums.zeros((5, 5))
    >>> sums.ones[:], sums.trials[:] = ones, 100
    >>> np.argwhere(look_hot(sums)).tolist()
    [[2, 3]]
    """
    from scipy.ndimage import median_filter

    usual = median_filter(sums.ones / np.maximum(sums.trials, 1), 3)
    expected = sums.trials * usual
    variance = np.maximum(expected * (1 - usual), 1.0)
    return np.asarray((sums.ones - expected) > _HOT * np.sqrt(variance))


def report_window(window: range, model: str) -> None:
    """Warn that a window replaces the counts that were merged along a motion of a model."""
    reason = "the motion does not explain the scene clearly better than no motion"
    if model == "none":
        reason = "the frames differ although the motion is none"
    warn(f"{reason}; only {len(window)} frames are used, and all pixels are flagged")


def _smooth(gains: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return gains that are averaged with those of the next shorter and the next longer window.

    The quality has one maximum, so the average has less noise than the gain of one window.

    Examples
    --------
    >>> _smooth(np.array([4.0, 8.0, 4.0])).round(2).tolist()
    [5.33, 6.0, 5.33]
    """
    weights = np.convolve(np.ones_like(gains), _SMOOTHING)[1:-1]
    return np.asarray(np.convolve(gains, _SMOOTHING)[1:-1] / weights)


def _gain_of(window: Sums, folds: list[Fold]) -> tuple[float, float]:
    """Return by how many nats a window is better than the merged counts, and the error."""
    gains = [fold.gain(window) for fold in folds]
    return sum(gain for gain, _ in gains), math.hypot(*(error for _, error in gains))
