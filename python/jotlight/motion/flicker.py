"""Flicker: frames whose light is a multiple of that of others.

Ones do not increase as much as the light where most bits are 1 already: with the factor f, the
probability of a one changes from p to 1 - (1 - p)^f.
"""

import dataclasses

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.motion.blocks import Sums
from jotlight.motion.equivalent import clip_probability
from jotlight.motion.scoring import Template

_MIN_CHANGE_OF_BLOCK, _MIN_CHANGE_OF_HALF = 0.03, 0.01
"""Smaller relative changes of the number of ones, of a block and of a half of the frames, have no
effect. In short blocks, they are mostly noise."""

_FEW_ZEROS = 0.1
"""Smallest probability of a zero below which changes of a block have an effect that are smaller in
proportion."""

_MAX_RATIO = 10.0
"""Largest ratio of the numbers of ones of two parts."""

_STEP = 4
"""Distance of the rows and columns from which the factor is computed."""

_ROUNDS = 8
"""Rounds of Newton's method for the factor."""


def min_change(template: Template) -> float:
    """Return the smallest relative change of the number of ones of a block that has an effect."""
    # The test multiplies p by smaller changes, which is wrong where 1 - p is as small as they are.
    zeros = min(1.0, (1 - float(template.probability.max())) / _FEW_ZEROS)
    return _MIN_CHANGE_OF_BLOCK * zeros


def at_brightness(template: Template, sums: Sums) -> Template:
    """Return the template as it would be in the light of a block of frames."""
    p = template.probability
    ratio = engine.brightness(sums.ones, sums.trials, p, template.threads)
    if not _is_change(ratio, min_change(template)):
        return template
    changed = _with_factor(p, light_factor(p, sums.trials, ratio))
    return Template(changed, template.trials, template.threads)


def without_saturation(first: Sums, second: Sums, threads: int | None = None) -> tuple[Sums, Sums]:
    """Return two sums whose ones have the same ratio in bright and in dark pixels.

    Only the sums with fewer ones are changed, to those that the light of the others predicts. The
    numbers are rounded, so nothing changes where the pixels are far from saturation.
    """
    ratio = engine.relative_brightness(
        first.ones, first.trials, second.ones, second.trials, threads
    )
    if not _is_change(ratio, _MIN_CHANGE_OF_HALF):
        return first, second
    if ratio > 1:
        return first, _proportional(second, first, ratio)
    return _proportional(first, second, 1 / ratio), second


def _proportional(darker: Sums, brighter: Sums, ratio: float) -> Sums:
    """Return sums with as many ones as those of brighter ones divided by their ratio."""
    total = np.maximum(darker.trials + brighter.trials, 1)
    p = clip_probability(np.asarray((darker.ones + brighter.ones) / total, np.float32))
    factor = light_factor(p, np.minimum(darker.trials, brighter.trials), ratio)
    # The probability of all bits is that of the mean light.
    dark, bright = (_with_factor(p, 2 * each / (1 + factor)) for each in (1.0, factor))
    excess = np.rint(darker.trials * (dark - bright / np.float32(ratio)))
    ones = np.clip(darker.ones - excess.astype(darker.ones.dtype), 0, darker.trials)
    return dataclasses.replace(darker, ones=ones.astype(darker.ones.dtype))


def light_factor(
    probability: npt.NDArray[np.floating], trials: npt.NDArray[np.number], ratio: float
) -> float:
    """Return by which factor the light changes if the number of ones changes by a ratio.

    Examples
    --------
    >>> p = 1 - np.exp(-np.array([[0.1, 2.0]]))
    >>> ones = 1 - np.exp(-1.5 * np.array([[0.1, 2.0]]))
    >>> round(light_factor(p, np.ones((1, 2)), ones.sum() / p.sum()), 6)
    1.5
    """
    p = probability[::_STEP, ::_STEP] if min(probability.shape) > _STEP else probability
    known = trials[::_STEP, ::_STEP] if min(probability.shape) > _STEP else trials
    light = -np.log1p(-p.astype(np.float64))
    wanted = ratio * float((known * p).sum())
    factor = ratio
    for _ in range(_ROUNDS):
        zeros = known * np.exp(-factor * light)
        slope = float((light * zeros).sum())
        if slope <= 0:
            break
        step = (float((known - zeros).sum()) - wanted) / slope
        factor = float(np.clip(factor - step, 1 / _MAX_RATIO**2, _MAX_RATIO**2))
    return factor


def _is_change(ratio: float, least: float) -> bool:
    """Return whether a ratio of numbers of ones is that of a change of the light."""
    return abs(ratio - 1) > least and 1 / _MAX_RATIO < ratio < _MAX_RATIO


def _with_factor(probability: npt.NDArray[np.floating], factor: float) -> npt.NDArray[np.float32]:
    """Return the probabilities of ones after a change of the light by a factor."""
    return clip_probability(-np.expm1(np.float32(factor) * np.log1p(-probability)))
