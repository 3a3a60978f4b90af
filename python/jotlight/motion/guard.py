"""A guard: where the motion is wrong, a short window without alignment may be better."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.scoring import read_network
from jotlight.motion.track import Paths
from jotlight.networks.trials_map import denoise_map

Counts = npt.NDArray[np.signedinteger]

_FRACTIONS = (1, 2, 4, 8, 16)
"""The windows have all frames, a half, a quarter, and so on."""

_CENTRAL_FRACTION = 16
"""Bits are held out from 1/16 of all frames."""

_MIN_PROBABILITY = 1e-4
"""Smallest distance of an estimated probability from 0 and from 1."""


def find_window(paths: Paths, total: Sums) -> range | None:
    """Return the frames whose sum without motion is better than the merged counts, or None.

    Half of the bits of a few frames at the reference time are held out, at random. The estimate of
    the network from the other bits that makes them most probable is the best one.

    Parameters
    ----------
    paths : Paths
        The motion.
    total : Sums
        The merged counts of all frames.
    """
    blocks = paths.blocks
    frames = len(blocks.burst)
    center = count_window(paths, _window(paths, max(2, frames // _CENTRAL_FRACTION)))
    held_trials = (center.trials // 2).astype(np.int64)
    # The seed is fixed, so that results repeat.
    held_ones = np.random.default_rng(0).hypergeometric(
        center.ones, center.trials - center.ones, held_trials
    )
    # The merged counts contain these bits, too, but at positions that rounding may have shifted.
    held = np.minimum(held_ones, total.ones), np.minimum(held_trials, total.trials)
    merged = _likelihood(total.ones - held[0], total.trials - held[1], held_ones, held_trials)
    best: tuple[float, range | None] = merged, None
    for fraction in _FRACTIONS:
        window = _window(paths, frames // fraction)
        if len(window) < frames // _CENTRAL_FRACTION:
            break
        counted = count_window(paths, window)
        likelihood = _likelihood(
            counted.ones - held_ones, counted.trials - held_trials, held_ones, held_trials
        )
        if likelihood > best[0]:
            best = likelihood, window
    return best[1]


def _window(paths: Paths, length: int) -> range:
    """Return the frames around the reference time, two or more."""
    frames, half = len(paths.blocks.burst), max(1, length // 2)
    middle = int(np.clip(round(paths.reference), half, max(half, frames - half)))
    return range(middle - half, min(middle + half, frames))


def count_window(paths: Paths, window: range) -> Sums:
    """Return the sums of frames without motion."""
    still = np.zeros((2, *paths.tracks[0].nodes.shape[2:]), np.float32)
    return paths.blocks.count(window, (still, still), (window.start, window.stop))


def _likelihood(ones: Counts, trials: Counts, held_ones: Counts, held_trials: Counts) -> float:
    """Return the log-likelihood of bits that were held out, in nats."""
    estimate = denoise_map(read_network(), ones.astype(np.float32), trials.astype(np.float32))
    p = np.clip(estimate.astype(np.float64), _MIN_PROBABILITY, 1 - _MIN_PROBABILITY)
    return float((held_ones * np.log(p) + (held_trials - held_ones) * np.log1p(-p)).sum())
