"""Whether a scene moves, from the counts of a few blocks of its frames.

If a scene moves, light moves from jots to their neighbors, so the counts of neighbors change
together. Afterpulsing and hot jots change the counts of single jots only. Where the light flickers,
the counts of all neighbors change in proportion to their light, so this part is removed first. If
several photons make a one, the change also depends on the pattern within a cell, so all that
follows the brightness of the whole image is removed.
"""

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.formats.capture import CountStack
from jotlight.motion.counts.burst import Burst, as_burst
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    inverse_detection_probability,
)

THRESHOLD = 6.0
"""A scene moves if the score exceeds this number of standard deviations."""

_BLOCKS = 4
"""Number of blocks of frames that are compared."""

_FRACTION, _MIN_FRAMES = 8, 32
"""Each block counts 1/8 of its frames, but 32 or more, if it has as many."""

_CELLS = 4, 8
"""Widths of the squares of jots whose counts are compared with those of their neighbors."""

_NEIGHBORS = (0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0)
"""Distances of neighbors, in rows and columns of cells."""

_WINDOW = 11
"""Width of the squares, in cells, in which the brightness may change without motion."""

_MIN_FLICKER = 0.05
"""Smallest change of the logarithm of the light at which the course of a flicker is removed, for
thresholds above 1. It takes up to half of the score of moving scenes."""


def motion_score(
    data: Bits | CountStack,
    *,
    threshold: int = 1,
    threads: int | None = None,
) -> float:
    """Return how strongly neighbors change together, in standard deviations.

    A score above :data:`THRESHOLD` means that the scene moves. The score does not depend on the
    brightness if all light flickers alike, on afterpulsing, or on hot jots. Two frames with a
    threshold above 1 are an exception: their flicker may look like motion.

    Parameters
    ----------
    data : Bits or CountStack
        T frames of bits, or of counts that state their trials. For one frame, or for less than
        16 x 16 jots, the score is 0.
    threshold : int
        q: the number of photons that make a jot report 1.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Notes
    -----
    At least 1/8 of the frames are counted, and all of up to 128. Let Δ be the deviation of a cell's
    count in a block of frames from its mean over all blocks, without what a change of brightness in
    its surroundings explains. If the scene stands still, the products of the Δ of neighbors have
    mean 0, whatever the distribution of each is. The score is the sum of these products over the
    root of the sum of their squares, for the size of cells where it is larger.

    Examples
    --------
    >>> rows = np.arange(64) // 8 % 2
    >>> still = np.broadcast_to(0.2 + 0.2 * rows[:, None], (64, 64, 64))
    >>> moving = np.stack([np.roll(frame, time // 4, axis=0) for time, frame in enumerate(still)])
    >>> noise = np.random.default_rng(0).random((64, 64, 64))
    >>> motion_score(jl.Bits.from_array(noise < still)) < THRESHOLD
    True
    >>> motion_score(jl.Bits.from_array(noise < moving)) > THRESHOLD
    True
    """
    burst = as_burst(data)
    if len(burst) < 2 or min(burst.size) < 2 * _CELLS[-1]:
        return 0.0
    blocks = min(_BLOCKS, len(burst))
    length = len(burst) // blocks
    counted = min(length, max(_MIN_FRAMES, length // _FRACTION))
    first = (length - counted) // 2
    counts = np.stack(
        [
            _count_cells(burst, range(start + first, start + first + counted), threads)
            for start in range(0, blocks * length, length)
        ]
    )
    scores = []
    for cell in _CELLS:
        factor = cell // _CELLS[0]
        shape = counts.shape[1] // factor, factor, counts.shape[2] // factor, factor
        sums = counts.reshape(blocks, *shape).sum(axis=(2, 4))
        deviations = _deviations(sums, counted * burst.trials * cell**2, threshold)
        scores.append(_score(deviations))
    return max(scores)


def _count_cells(burst: Burst, frames: range, threads: int | None) -> npt.NDArray[np.int64]:
    """Return the counts of the smallest cells. Those at the end that are incomplete are left out.

    The numbers of rows and columns are even, so that the cells divide into larger ones.
    """
    height, width = (length // _CELLS[-1] * _CELLS[-1] for length in burst.size)
    total = np.zeros((height // _CELLS[0], width // _CELLS[0]), np.int64)
    for _, planes in burst.parts(frames):
        for weight, packed in planes:
            part = Bits(packed[:, :height, : width // 8], width)
            total += weight * part.counts(_CELLS[0], threads=threads)
    return total


def _deviations(counts: npt.NDArray[np.int64], trials: int, threshold: int) -> Array:
    """Return the deviations of the counts (n, h, w) from those that a flicker would explain.

    The unit is their standard deviation.
    """
    fractions = np.clip(counts / trials, 0.5 / trials, 1 - 0.5 / trials)
    mean = fractions.mean(axis=0)
    nearby = _window_sums(np.ones(mean.shape))
    brightness, usual = _window_sums(fractions) / nearby, _window_sums(mean) / nearby
    light = inverse_detection_probability(threshold, mean, 1 - mean)
    factor = inverse_detection_probability(threshold, brightness, 1 - brightness)
    factor = factor / inverse_detection_probability(threshold, usual, 1 - usual)
    # The factors are approximate, the brightness changes within a block, and the light differs
    # within a cell. This removes the effects to second order.
    effect = light * detection_density(threshold, factor * light)
    curvature = effect * ((threshold - 1) / factor - light)
    deviations = fractions - detection_probability(threshold, factor * light)
    curvature = curvature - _share(curvature, effect) * effect
    deviations = deviations - _share(deviations, effect) * effect
    deviations = deviations - _share(deviations, curvature) * curvature
    if threshold > 1:
        deviations = _without_course(deviations, fractions.mean(axis=(1, 2)), threshold)
    deviations = deviations * np.sqrt(trials / (usual * (1 - usual)))
    # Where nothing changes, the deviations are rounding errors.
    return np.where(abs(deviations) > 1e-6, deviations, 0.0)


def _without_course(deviations: Array, brightness: Array, threshold: int) -> Array:
    """Return deviations (n, h, w) without the parts of cells that are constant or follow the light.

    The brightness (n,) is that of the whole image. A cell whose pixels differ much changes more or
    less than others of the same count, but at the same times.
    """
    course = np.log(inverse_detection_probability(threshold, brightness, 1 - brightness))
    if np.ptp(course) < _MIN_FLICKER or len(course) < 3:
        return deviations
    course -= course.mean()
    deviations = deviations - deviations.mean(axis=0)
    follows = np.tensordot(course, deviations, axes=1) / (course @ course)
    return np.asarray(deviations - course[:, None, None] * follows)


def _share(values: Array, part: Array) -> Array:
    """Return the multiple of a part that explains values best in each window."""
    return np.asarray(_window_sums(part * values) / np.maximum(_window_sums(part**2), 1e-30))


def _score(deviations: Array) -> float:
    """Return the sum of the products of neighbors in standard deviations."""
    _, height, width = deviations.shape
    total, squares = 0.0, 0.0
    for row, column in _NEIGHBORS:
        left, right = max(0, -column), max(0, column)
        first = deviations[:, : height - row, left : width - right]
        second = deviations[:, row:, right : width - left]
        products = (first * second).sum(axis=0)
        total += float(products.sum())
        squares += float((products**2).sum())
    return total / squares**0.5 if squares > 0 else 0.0


def _window_sums(values: Array) -> Array:
    """Return the sums over the windows around all cells, (..., h, w)."""
    for axis in (-2, -1):
        length = values.shape[axis]
        ends = np.arange(length) + (_WINDOW + 1) // 2
        total = np.cumsum(np.insert(values, 0, 0, axis=axis), axis=axis)
        values = total.take(np.minimum(ends, length), axis) - total.take(
            np.maximum(ends - _WINDOW, 0), axis
        )
    return values
