"""A guard: where the motion is wrong, a short window without alignment may be better."""

import dataclasses
import math
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.equivalent import equivalent_sums, expected_probability
from jotlight.motion.scoring import read_network
from jotlight.motion.track import Paths
from jotlight.networks.trials_map import denoise_map

Probability = npt.NDArray[np.floating]
Numbers = npt.NDArray[np.int64]

_FRACTIONS = (1, 2, 4, 8, 16, 32)
"""The windows have all frames, a half, a quarter, and so on."""

_CENTRAL = 2, 4
"""Numbers of frames from which bits are held out: of fast motions, and of slow ones."""

_MAX_STEP = 3.0
"""Displacement of a slow motion during the larger number of frames, in pixels."""

_MIN_GAIN = 0.5
"""Minimum gain of a window in standard deviations, for the motion to be wrong.

Where the merged counts were 1 dB better than the best window, it was -2 or less.
"""

_SMOOTHING = 0.25, 0.5, 0.25
"""Weights of the gains of windows of neighboring lengths."""

_MIN_PROBABILITY = 1e-4
"""Smallest distance of an estimated probability from 0 and from 1."""


def find_window(paths: Paths, total: Sums) -> range | None:
    """Return the frames whose sum without motion is better than the merged counts, or None.

    The bits of a few frames at the reference time are divided into halves, at random. Each half is
    held out in turn. The estimate of the network from the other bits that makes the bits of both
    halves most probable is the best one. Between these frames, the scene must hardly move. So only
    two of them are taken if the motion is fast, and four, which contain more information, if it is
    slow.

    Parameters
    ----------
    paths : Paths
        The motion.
    total : Sums
        The merged counts of all frames.
    """
    blocks = paths.blocks
    frames = len(blocks.burst)
    central = _CENTRAL[int(_longest_step(paths) <= _MAX_STEP)]
    center = count_window(paths, _window(paths, central))
    folds = [_Fold.of(center, total, *half) for half in _halves(center)]
    lengths = sorted({max(central, frames // fraction) for fraction in _FRACTIONS})
    windows = [_window(paths, length) for length in lengths]
    gains, errors = np.transpose([_gain_of(count_window(paths, each), folds) for each in windows])
    smooth = _smooth(gains)
    best = int(np.argmax(smooth))
    return windows[best] if smooth[best] > _MIN_GAIN * errors[best] else None


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


def _halves(center: Sums) -> list[tuple[Numbers, Numbers]]:
    """Return the ones and trials of two random halves of the bits."""
    trials = (center.trials // 2).astype(np.int64)
    # The seed is fixed, so that results repeat.
    ones = np.random.default_rng(0).hypergeometric(center.ones, center.trials - center.ones, trials)
    return [(ones, trials), (center.ones - ones, center.trials - trials)]


@dataclasses.dataclass(frozen=True)
class _Fold:
    """Bits of the central frames that are held out."""

    held: Sums
    merged: Probability
    """The estimate from the merged counts without these bits."""

    @classmethod
    def of(cls, center: Sums, total: Sums, ones: Numbers, trials: Numbers) -> Self:
        """Return the fold that holds out some of the bits of the central frames."""
        # The merged counts contain these bits, too, but at positions that rounding may have
        # shifted.
        rest = total.without(np.minimum(ones, total.ones), np.minimum(trials, total.trials))
        held = center.without(center.ones - ones, center.trials - trials)
        return cls(held, _estimate(rest))

    def estimate_from(self, window: Sums) -> Probability:
        """Return the estimate from the other bits of a window."""
        return _estimate(window.without(self.held.ones, self.held.trials))


def _gain_of(window: Sums, folds: list[_Fold]) -> tuple[float, float]:
    """Return by how many nats a window is better than the merged counts, and the error."""
    gains = [_gain(fold.estimate_from(window), fold.merged, fold.held) for fold in folds]
    return sum(gain for gain, _ in gains), math.hypot(*(error for _, error in gains))


def _longest_step(paths: Paths) -> float:
    """Return the root-mean-square displacement during the larger number of central frames.

    It is that of the track that moves most.
    """
    centers = paths.blocks.centers
    near = np.argsort(abs(centers - paths.reference), kind="stable")[:2]
    if len(near) < 2:
        return 0.0
    steps = [track.nodes[near[1]] - track.nodes[near[0]] for track in paths.tracks]
    longest = max(float(np.sqrt(2 * np.mean(step**2))) for step in steps)
    return longest / abs(float(centers[near[1]] - centers[near[0]])) * _CENTRAL[1]


def _window(paths: Paths, length: int) -> range:
    """Return the frames around the reference time, two or more."""
    frames, half = len(paths.blocks.burst), max(1, length // 2)
    middle = int(np.clip(round(paths.reference), half, max(half, frames - half)))
    return range(middle - half, min(middle + half, frames))


def count_window(paths: Paths, window: range) -> Sums:
    """Return the sums of frames without motion."""
    still = np.zeros((2, *paths.tracks[0].nodes.shape[2:]), np.float32)
    return paths.blocks.count(window, (still, still), (window.start, window.stop))


def _estimate(sums: Sums) -> Probability:
    """Return the probabilities that the network estimates for the reference jot, (H, W)."""
    sums = equivalent_sums(sums)
    ones, trials = sums.ones.astype(np.float32), sums.trials.astype(np.float32)
    estimate = denoise_map(read_network(), ones, trials)
    return np.clip(estimate, np.float32(_MIN_PROBABILITY), np.float32(1 - _MIN_PROBABILITY))


def _gain(first: Probability, second: Probability, held: Sums) -> tuple[float, float]:
    """Return by how many nats bits are more probable under the first estimate, and its error."""
    ones, trials = held.ones, held.trials
    first, second = (
        expected_probability(held, each).astype(np.float64) for each in (first, second)
    )
    of_one, of_zero = np.log(first / second), np.log((1 - first) / (1 - second))
    gain = float((ones * of_one + (trials - ones) * of_zero).sum())
    variance = trials * first * (1 - first) * (of_one - of_zero) ** 2
    return gain, float(np.sqrt(variance.sum()))
