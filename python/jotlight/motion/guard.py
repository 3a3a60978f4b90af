"""A guard: where the motion is wrong, a short window without alignment may be better."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.equivalent import equivalent_sums, expected_probability
from jotlight.motion.scoring import read_network
from jotlight.motion.track import Paths
from jotlight.networks.trials_map import denoise_map

Probability = npt.NDArray[np.floating]

_FRACTIONS = (1, 2, 4, 8, 16, 32)
"""The windows have all frames, a half, a quarter, and so on."""

_CENTRAL = 2, 4
"""Numbers of frames from which bits are held out: of fast motions, and of slow ones."""

_MAX_STEP = 3.0
"""Displacement of a slow motion during the larger number of frames, in pixels."""

_MIN_GAIN = 3.0
"""Minimum gain of a window in standard deviations, for the motion to be wrong."""

_MIN_PROBABILITY = 1e-4
"""Smallest distance of an estimated probability from 0 and from 1."""


def find_window(paths: Paths, total: Sums) -> range | None:
    """Return the frames whose sum without motion is better than the merged counts, or None.

    Half of the bits of a few frames at the reference time are held out, at random. The estimate of
    the network from the other bits that makes them most probable is the best one. Between these
    frames, the scene must hardly move. So only two of them are taken if the motion is fast, and
    four, which contain more information, if it is slow.

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
    held_trials = (center.trials // 2).astype(np.int64)
    # The seed is fixed, so that results repeat.
    held_ones = np.random.default_rng(0).hypergeometric(
        center.ones, center.trials - center.ones, held_trials
    )
    # The merged counts contain these bits, too, but at positions that rounding may have shifted.
    merged = _estimate(
        total.without(np.minimum(held_ones, total.ones), np.minimum(held_trials, total.trials))
    )
    held = center.without(center.ones - held_ones, center.trials - held_trials)
    best: tuple[float, range | None] = 0.0, None
    for length in sorted({max(central, frames // fraction) for fraction in _FRACTIONS}):
        window = _window(paths, length)
        counted = count_window(paths, window)
        estimate = _estimate(counted.without(held_ones, held_trials))
        gain, error = _gain(estimate, merged, held)
        if gain > max(best[0], _MIN_GAIN * error):
            best = gain, window
    return best[1]


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
