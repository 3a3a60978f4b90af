"""Random maps of trials, with which K-conditioned networks learn pixels of different K."""

import math

import numpy as np
import numpy.typing as npt

from jotlight.estimators.trial_levels import fill_from_nearest, local_trials

Map = npt.NDArray[np.float64]

MAX_TRIALS = 1 << 16
"""Largest number of trials in a map."""

_DEAD_RANGE = 0.002, 0.1
"""Fraction of the pixels with dead jots."""

_STEP_RANGE = 0.5, 5.0
"""Ratio of the trials on two sides of a border, in powers of two."""

_SLOPE_RANGE = 0.5, 3.0
"""Ratio of the most to the fewest trials of a smooth map, in powers of two."""

_BLEND = 0.25
"""Distance from a level, in powers of two, from which it shares a pixel with the next level.

The next one is at 0.5, as in :mod:`jotlight.estimators.trial_levels`.
"""


def draw_trials_map(rng: np.random.Generator, side: int, trials: int) -> Map:
    """Return a random map of whole numbers of trials, (side, side), around K = `trials`.

    Four kinds are equally probable: pixels with dead jots, dead rows and columns, a border between
    two numbers of trials, and a smooth map, like that of vignetting. Some pixel is not dead.

    Examples
    --------
    >>> trials = draw_trials_map(np.random.default_rng(0), 48, 16)
    >>> trials.shape, bool((trials >= 0).all())
    ((48, 48), True)
    """
    kinds = _dead_jots, _dead_lines, _border, _smooth
    drawn = kinds[rng.integers(len(kinds))](rng, side, trials)
    return np.clip(np.rint(drawn), 0, MAX_TRIALS)


def draw_counts(
    rng: np.random.Generator, probability: Map, trials: Map, level: int
) -> npt.NDArray[np.float32]:
    """Return counts L (H, W) in which each pixel of probability P(b = 1) has its own trials.

    They are scaled to K = `level`. Pixels without trials have the value of the nearest pixel with
    trials, as in a reconstruction.
    """
    known = trials > 0
    if not known.any():
        return np.full(trials.shape, level / 2, np.float32)
    ones = rng.binomial(trials.astype(np.int64), probability)
    return fill_from_nearest(level * ones / np.where(known, trials, 1), known)


def serving_weights(trials: Map, level: int) -> npt.NDArray[np.float32]:
    """Return the weight (H, W) from 0 to 1 with which a level of K serves each pixel.

    It is 1 where the trials around a pixel are nearly those of the level, and 0 where other levels
    serve the pixel.

    Examples
    --------
    >>> trials = np.where(np.arange(90) < 45, 4.0, 5.6) * np.ones((8, 1))
    >>> serving_weights(trials, 4)[0, [0, 44, 45, 89]].round(2)
    array([1.  , 1.  , 0.98, 0.06], dtype=float32)
    """
    known = trials > 0
    if not known.any():
        return np.zeros(trials.shape, np.float32)
    local = local_trials(fill_from_nearest(trials, known))
    distances = np.log2(np.broadcast_to(local, trials.shape) / level)
    weights = np.where(distances < 0, distances + _BLEND, 2 * _BLEND - distances) / _BLEND
    return np.asarray(np.clip(weights, 0, 1), np.float32)


def _dead_jots(rng: np.random.Generator, side: int, trials: int) -> Map:
    """Return K, and 0 to K/2 trials in random pixels, half of them 0."""
    fraction = _log_uniform(rng, _DEAD_RANGE)
    chance = rng.random((side, side))
    fewer = rng.integers(trials // 2 + 1, size=(side, side))
    few = np.where(chance < fraction / 2, 0, fewer)
    return np.where(chance < fraction, few, trials).astype(np.float64)


def _dead_lines(rng: np.random.Generator, side: int, trials: int) -> Map:
    """Return K, and no trials in one to three rows or columns, one or two pixels wide."""
    result = np.full((side, side), float(trials))
    for _ in range(rng.integers(1, 4)):
        start, width = rng.integers(side), rng.integers(1, 3)
        line = result if rng.random() < 1 / 2 else result.T
        line[start : start + width] = 0
    return result


def _border(rng: np.random.Generator, side: int, trials: int) -> Map:
    """Return K on one side of a straight border, and more or fewer trials on the other one."""
    angle, ratio = rng.uniform(0, 2 * math.pi), 2 ** rng.uniform(*_STEP_RANGE)
    row, column = np.mgrid[:side, :side] - rng.uniform(0, side, 2)[:, None, None]
    is_other = row * math.sin(angle) + column * math.cos(angle) > 0
    other = trials * (ratio if rng.random() < 1 / 2 else 1 / ratio)
    return np.where(is_other, other, trials).astype(np.float64)


def _smooth(rng: np.random.Generator, side: int, trials: int) -> Map:
    """Return trials that increase from one side to the other one, from below K to above it."""
    angle, octaves = rng.uniform(0, 2 * math.pi), rng.uniform(*_SLOPE_RANGE)
    row, column = (np.mgrid[:side, :side] - (side - 1) / 2) / side
    rise = row * math.sin(angle) + column * math.cos(angle)
    return np.asarray(trials * 2 ** (octaves * rise))


def _log_uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    """Return a number, uniform on a logarithmic scale."""
    return math.exp(rng.uniform(math.log(bounds[0]), math.log(bounds[1])))
