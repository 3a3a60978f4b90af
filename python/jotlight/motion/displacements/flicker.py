"""Flicker: frames whose light is a multiple of that of others.

Ones do not increase as much as the light where most bits are 1 already: with the factor f, the
probability of a one changes from p to 1 - (1 - p)^f. If q photons make a one, they increase more
where most bits are 0: P(q, s) changes to P(q, f s).
"""

import dataclasses

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import AnyArray, Image
from jotlight.motion.counts.equivalent import clip_probability, equivalent_sums
from jotlight.motion.counts.lights import Lights
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.scoring import Template
from jotlight.underflow import underflows_to_0

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

_LEVELS = 4096
"""Number of levels of the light of pixels for which the factor is found."""

_MAX_STEP = 0.5
"""Largest change of the logarithm of light in a round of Newton's method."""

_MAX_HALF = 3.0
"""Largest logarithm of the common factor of the light of two parts, halved."""

_MIN_SLOPE = np.float32(1e-6)
"""Smallest slope by which Newton's method divides."""


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
    factor = light_factor(p, sums.trials, ratio, template.lights)
    return Template(_with_factor(p, factor, template.lights), template.trials, template.threads)


def change_of_light(template: Template, sums: Sums) -> float:
    """Return the light of a block of frames, in the unit of the lights of a template."""
    p = template.probability
    sums = equivalent_sums(sums, p)
    ratio = engine.brightness(sums.ones, sums.trials, p, template.threads)
    return light_factor(p, sums.trials, ratio, template.lights)


def without_saturation(
    first: Sums,
    second: Sums,
    threads: int | None = None,
    lights: tuple[Lights, Lights] | None = None,
) -> tuple[Sums, Sums]:
    """Return two sums whose ones have the same ratio in bright and in dark pixels.

    Only the sums with fewer ones are changed, to those that the light of the others predicts. The
    numbers are rounded, so nothing changes where the pixels are far from saturation. If jots need
    several photons, `lights` are those of both sums. Of jots that differ, the sums then become
    equivalent counts.
    """
    ratio = engine.relative_brightness(
        first.ones, first.trials, second.ones, second.trials, threads
    )
    if not _is_change(ratio, _MIN_CHANGE_OF_HALF):
        return first, second
    if lights is not None:
        first, second = _of_reference_jot(first), _of_reference_jot(second)
        ratio = engine.relative_brightness(
            first.ones, first.trials, second.ones, second.trials, threads
        )
    if ratio > 1:
        return first, _proportional(second, first, ratio, lights and lights[::-1])
    return _proportional(first, second, 1 / ratio, lights), second


def _of_reference_jot(sums: Sums) -> Sums:
    """Return equivalent counts, because the ones of other jots follow other powers of the light."""
    if sums.jots is None:
        return sums.real()
    sums = equivalent_sums(sums)
    return dataclasses.replace(sums, ones=np.clip(sums.ones, 0, sums.trials))


def _proportional(
    darker: Sums, brighter: Sums, ratio: float, lights: tuple[Lights, Lights] | None
) -> Sums:
    """Return sums with as many ones as those of brighter ones divided by their ratio."""
    total = np.maximum(darker.trials + brighter.trials, 1)
    p = clip_probability(np.asarray((darker.ones + brighter.ones) / total, np.float32))
    known = np.minimum(darker.trials, brighter.trials)
    if lights is None:
        factor = light_factor(p, known, ratio)
        # The probability of all bits is that of the mean light.
        dark, bright = (_with_factor(p, 2 * each / (1 + factor)) for each in (1.0, factor))
    else:
        share = np.asarray(brighter.trials / total, np.float32)
        dark, bright = _parts_of_light(p, share, known, ratio, lights)
    excess = np.rint(darker.trials * (dark - bright / np.float32(ratio)))
    ones = np.clip(darker.ones - excess.astype(darker.ones.dtype), 0, darker.trials)
    return dataclasses.replace(darker, ones=ones.astype(darker.ones.dtype))


def _parts_of_light(
    probability: Image, share: Image, trials: AnyArray, ratio: float, lights: tuple[Lights, Lights]
) -> list[Image]:
    """Return the probability of a one in darker and in brighter bits, from that of all bits.

    Newton's method finds the light of each pixel, with that probability, and a common factor of the
    light of both parts, with that ratio of their ones.
    """
    light, half = lights[0].inverse(probability), 0.0
    for _ in range(_ROUNDS):
        own = [light * np.float32(np.exp(each)) for each in (-half, half)]
        (dark, dark_slope), (bright, bright_slope) = (
            each.response(seen) for each, seen in zip(lights, own, strict=True)
        )
        slopes = own[0] * dark_slope, own[1] * bright_slope
        ones = [max(float((trials * each).sum()), 1e-9) for each in (dark, bright)]
        change = sum(float((trials * each).sum()) / n for each, n in zip(slopes, ones, strict=True))
        missing = np.log(ratio * ones[0] / ones[1])
        half = float(np.clip(half + missing / max(change, 1e-9), -_MAX_HALF, _MAX_HALF))
        error = dark + share * (bright - dark) - probability
        slope = slopes[0] + share * (slopes[1] - slopes[0])
        step = np.clip(error / np.maximum(slope, _MIN_SLOPE), -_MAX_STEP, _MAX_STEP)
        light = np.asarray(light * np.exp(-step), np.float32)
    return [
        clip_probability(each.response(light * np.float32(np.exp(sign * half)))[0])
        for each, sign in zip(lights, (-1, 1), strict=True)
    ]


@underflows_to_0
def light_factor(
    probability: npt.NDArray[np.floating],
    trials: npt.NDArray[np.number],
    ratio: float,
    lights: Lights | None = None,
) -> float:
    """Return by which factor the light changes if the number of ones changes by a ratio.

    If jots need several photons, `lights` are those with which the probabilities were found, and
    the result is in their unit.

    Examples
    --------
    >>> p = 1 - np.exp(-np.array([[0.1, 2.0]]))
    >>> ones = 1 - np.exp(-1.5 * np.array([[0.1, 2.0]]))
    >>> round(light_factor(p, np.ones((1, 2)), ones.sum() / p.sum()), 6)
    1.5
    """
    p = probability[::_STEP, ::_STEP] if min(probability.shape) > _STEP else probability
    known = trials[::_STEP, ::_STEP] if min(probability.shape) > _STEP else trials
    if lights is not None:
        return _factor_of_several(p, known, ratio, lights)
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


def _factor_of_several(p: Image, trials: AnyArray, ratio: float, lights: Lights) -> float:
    """Return the factor of the light for jots that need several photons.

    Newton's method finds its logarithm, because ones are about proportional to powers of the light.
    """
    light, after = lights.inverse(p), Lights(lights.threshold)
    # The sums are those over levels of the light, which takes less time than those over pixels.
    step = max(float(light.max()), 1.0) / _LEVELS
    number = np.bincount(np.rint(light.ravel() / step).astype(int), trials.ravel())
    levels = np.arange(len(number), dtype=np.float32) * np.float32(step)
    factor, wanted = 1.0, ratio * float((number * lights.response(levels)[0]).sum())
    for _ in range(_ROUNDS):
        changed, slopes = after.response(np.float32(factor) * levels)
        ones, slope = float((number * changed).sum()), float((number * levels * slopes).sum())
        if min(slope, wanted) <= 0:
            break
        change = np.clip(np.log(wanted / ones) * ones / (factor * slope), -_MAX_STEP, _MAX_STEP)
        factor = float(np.clip(factor * np.exp(change), 1 / _MAX_RATIO**2, _MAX_RATIO**2))
    return factor


def _is_change(ratio: float, least: float) -> bool:
    """Return whether a ratio of numbers of ones is that of a change of the light."""
    return abs(ratio - 1) > least and 1 / _MAX_RATIO < ratio < _MAX_RATIO


def _with_factor(
    probability: npt.NDArray[np.floating], factor: float, lights: Lights | None = None
) -> Image:
    """Return the probabilities of ones after a change of the light by a factor."""
    if lights is not None:
        light = np.float32(factor) * lights.inverse(probability)
        return clip_probability(Lights(lights.threshold).response(light)[0])
    return clip_probability(-np.expm1(np.float32(factor) * np.log1p(-probability)))
