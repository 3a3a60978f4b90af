"""How much counts along a motion disagree with a template, or with each other."""

import dataclasses
from typing import Any

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.blur import blur
from jotlight.motion.counts.equivalent import equivalent_sums, estimate_probability
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.scoring import Template, without_shift
from jotlight.squares import repeat_squares

_SPREAD = 8.0
"""Standard deviation of the filter that averages the disagreement, in pixels."""

_SQUARE = 4
"""Side of the squares over which the engine adds the disagreement, in pixels."""

_MAX_TRIALS = 512
"""Maximum number of trials in a test. More trials count as this number of them.

They would show errors that do not matter, such as those of rounding to whole pixels.
"""

FEW_TRIALS = 128
"""Number of trials above which a test notices that rounding has shifted a block."""

_PRIOR = 0.01
"""Weight with which pixels are assumed to agree where few are known."""


def chi_squared(sums: Sums, template: Template) -> Image:
    """Return χ² of each pixel, (H, W), which is about 1 if the sums agree with the template.

    Residual counts and their variances are added in squares of 3 pixels. The ratios of the squared
    residuals to the variances are averaged in squares of 9 pixels. If there are many trials, the
    template is shifted as rounding has shifted the sums.
    """
    probability, threads = template.probability, template.threads
    if sums.trials.max() > FEW_TRIALS:
        moved = dataclasses.replace(sums, remainders=-sums.remainders)
        probability = without_shift(probability, moved, threads).probability
    sums = equivalent_sums(_limit_trials(sums), probability)
    out = np.empty_like(probability)
    engine.chi_squared(sums.ones, sums.trials, probability, template.trials, out, threads)
    return out


def disagreement(first: Sums, second: Sums, threads: int | None = None) -> Image:
    """Return how much two parts of the frames disagree around each pixel, (H, W).

    It is the square of the difference of their counts in units of its variance, averaged over many
    pixels: about 1 if they agree. One may be brighter than the other, by the same factor
    everywhere. Squares of 4 pixels have equal values.
    """
    height, width = first.ones.shape
    squares = np.empty((2, -(-height // _SQUARE), -(-width // _SQUARE)), np.float32)
    first, second = _limit_trials(first), _limit_trials(second)
    if first.jots is not None or second.jots is not None:
        probability = estimate_probability(first + second)
        # One of them may have no bits, and so no jots.
        first, second = (equivalent_sums(each, probability).real() for each in (first, second))
    engine.disagreement(first.ones, first.trials, second.ones, second.trials, squares, threads)
    ratios, known = blur(squares / _SQUARE**2, _SPREAD / _SQUARE, threads)
    values = (ratios + _PRIOR) / (known + _PRIOR)
    return repeat_squares(np.asarray(values), _SQUARE, (height, width))


def _limit_trials(sums: Sums) -> Sums:
    """Return sums with at most :data:`_MAX_TRIALS` trials per pixel."""
    largest = int(sums.trials.max())
    if largest <= _MAX_TRIALS:
        return sums
    factor = np.float32(_MAX_TRIALS / largest)
    parts: list[Any] = [factor * sums.ones, factor * sums.trials]
    if sums.ones.dtype == np.int32:  # equivalent counts are real numbers
        parts = [np.rint(each).astype(np.int32) for each in parts]
    ones, trials = parts
    jots = None if sums.jots is None else sums.jots * (trials / np.maximum(sums.trials, 1))
    return dataclasses.replace(sums, ones=ones, trials=trials, jots=jots)
