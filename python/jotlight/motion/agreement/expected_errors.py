"""Where errors of a motion are expected although single pixels do not show them.

A wrong displacement changes an image where it is steep. In dim light, the bits of a pixel do not
show this. But displacements are smooth, so the bits of many tiles together show whether the frames
that are farthest from the reference time are displaced.
"""

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Mask
from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.displacements.affine import against_others
from jotlight.motion.displacements.deformation_prior import (
    DeformationPrior,
    Measurement,
    degrees_of_freedom,
    gain_of_deviations,
)
from jotlight.motion.displacements.flicker import at_brightness
from jotlight.motion.displacements.scoring import Template, normal_equations

Kind = TypeVar("Kind", np.float32, np.bool_)

_SIGMA = 2.0
"""Width of the filter with which displacements are measured, in pixels."""

_DEVIATION = 2.0
"""Standard deviation of the displacements that are expected if the motion is wrong, in pixels."""

_CLEAR = 1.9
"""Number of standard deviations of noise by which displacements must explain the bits better.

The template contains the noise of the bits, so displacements explain them worse on average. In 102
simulated scenes of a moving camera, the largest number was 1.8, and the median -1.1.
"""

_MAX_ONES = 20.0
"""Mean number of ones of a pixel from which on its bits show wrong displacements."""

_FEW_ONES = 8.0
"""Mean number of ones of a pixel up to which displacements can be tested.

With more ones, errors of the template of fine patterns are taken for displacements.
"""

_MAX_OUTERMOST = 0.5
"""Fraction of all frames up to which the outermost ones can be compared with a template of all.

Films of one motion have larger rings, and are not tested.
"""

_SHARE = 0.98
"""Part of the squared slopes of an image that is in its steep pixels, and near them."""

_REACH = 3
"""Distance in pixels up to which a steep edge may be displaced."""


def is_dim(consistent: Consistent) -> bool:
    """Return whether there is so little light that pixels hardly show wrong displacements."""
    return float(consistent.total.ones.mean()) < _MAX_ONES


def may_hide_displacements(consistent: Consistent) -> bool:
    """Return whether there is so little light that only many tiles together show displacements.

    The result is False if :func:`is_displaced` cannot tell: if the outermost frames are none or
    most of all, and if jots need several photons, because the light of the frames is unknown then.
    """
    total = consistent.total
    outermost = sum(sums.frames for sums in consistent.outermost)
    can_tell = 0 < outermost <= _MAX_OUTERMOST * total.frames and consistent.lights is None
    return can_tell and float(total.ones.mean()) < _FEW_ONES


def is_displaced(consistent: Consistent, template: Template) -> bool:
    """Return whether the frames farthest from the reference time are displaced from a template.

    The displacements of tiles are probably smooth. They must explain the bits better than those
    that noise causes. An affine motion of all pixels is known, so it is not noticed.

    Parameters
    ----------
    consistent : Consistent
        The sums along the motion.
    template : Template
        The template of all of them.
    """
    information, right = [], []
    for sums in consistent.outermost:
        if sums.frames > 0:
            equations = normal_equations(sums, at_brightness(template, sums), _SIGMA)
            equations = against_others(equations, sums, template)
            information.append(equations.information)
            right.append(-equations.right)
    measurement = Measurement(np.stack(information), np.stack(right))
    number, _, rows, columns = measurement.right.shape
    prior = DeformationPrior.of_fields(number, (rows, columns), _DEVIATION)
    freedom = max(degrees_of_freedom(prior, measurement), 0.0)
    excess = gain_of_deviations(prior, measurement) - freedom
    return excess > _CLEAR * float(np.sqrt(2 * freedom + 1))


def steep_pixels(template: Template) -> Mask:
    """Return the pixels (H, W) at which wrong displacements would change an image most.

    If all displacements were equally wrong, these pixels would contain nearly all of the squared
    error. Others are so smooth that a displacement hardly changes them.
    """
    slopes = np.square(np.gradient(template.probability)).sum(axis=0)
    near = largest_nearby(slopes, _REACH)
    falling = np.sort(near, axis=None)[::-1]
    total = np.cumsum(falling, dtype=np.float64)
    smallest = falling[np.searchsorted(total, _SHARE * total[-1])]
    return np.asarray((near >= smallest) & (near > 0))


def largest_nearby(values: npt.NDArray[Kind], distance: int) -> npt.NDArray[Kind]:
    """Return the largest value in the square neighborhood of each pixel, (H, W).

    For booleans, these are the pixels near one that is True.
    """
    largest = values.copy()
    for image in (largest, largest.T):
        before = image.copy(order="K")
        for shift in range(1, distance + 1):
            np.maximum(image[shift:], before[:-shift], out=image[shift:])
            np.maximum(image[:-shift], before[shift:], out=image[:-shift])
    return largest
