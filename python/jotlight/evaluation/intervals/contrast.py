"""The contrast of the bits of captures that are nearly empty because of a high threshold."""

import dataclasses
from functools import lru_cache
from typing import Self

import numpy as np

from jotlight.array_types import Array
from jotlight.blur import blur
from jotlight.sensing.parameters.binomial import squared_sine
from jotlight.sensing.parameters.response import detection_density, inverse_detection_probability

_SIDE = 33
"""Side of the window in which the brightest pixel is found, in pixels."""

_SMOOTH = 8.0
"""Standard deviation of the filter of the ones of these pixels."""

_FEW_ONES = 1.0
"""Expected ones of the brightest pixel nearby at which half of the contrast counts."""

_MAX_PROBABILITY = 1 - 1e-9
"""Largest probability whose contrast is computed."""

_NODES = np.geomspace(1e-15, np.pi / 2, 1025)
"""Values of z at which the contrast is computed."""


@dataclasses.dataclass(frozen=True)
class Contrast:
    """How much more errors vary behind a high threshold than those of the error model.

    With few ones, an estimate is a mean over many pixels. The error model is that of photographs
    with threshold 1, where the probability p of a one differs between these pixels about as much as
    the light. Behind a threshold q, it is about the light to the power of q. So the scale of errors
    is multiplied by the square root of the ratio of both contrasts. With about one 1 or more in the
    brightest pixels nearby, estimates show the contrast themselves, and held-out bits show the
    errors.
    """

    threshold: int
    weight: float | Array
    """How much the contrast counts, from 0 to 1: a number, or a map (H, W)."""
    dark_counts: float = 0.0
    """Dark counts per jot and frame, which hide the contrast of the light."""

    @classmethod
    def of(cls, threshold: int, z: Array, trials: Array, dark_counts: float = 0.0) -> Self:
        """Return the contrast of bits whose estimate is z = arcsin √p, (H, W).

        `trials` is their number in each pixel, (H, W).

        Examples
        --------
        >>> z, trials = np.full((8, 8), 0.25), np.full((8, 8), 16.0)
        >>> Contrast.of(4, z, trials).weight[0, 0].round(2), Contrast.of(1, z, trials).weight
        (np.float64(0.51), 0.0)
        """
        from scipy.ndimage import maximum_filter

        if threshold == 1:
            return cls(threshold, 0.0)
        bright = maximum_filter(blur(squared_sine(z), 1.0), _SIDE, mode="nearest")
        ones = np.median(trials) * blur(bright, _SMOOTH)
        return cls(threshold, 1 / (1 + (ones / _FEW_ONES) ** 2), dark_counts)

    def factor(self, z: Array) -> Array | float:
        """Return the factor of the scale of the errors of z.

        Examples
        --------
        >>> Contrast(4, 1.0).factor(np.array([0.001, 0.5])).round(2).tolist()  # at most 2 = √4
        [1.99, 1.6]
        >>> Contrast(1, 0.0).factor(np.array([0.001, 0.5]))
        1.0
        """
        if self.threshold == 1:
            return 1.0
        ratio = _ratio_of_slopes(self.threshold, self.dark_counts)
        return np.asarray(np.interp(z, _NODES, ratio) ** (self.weight / 2))


@lru_cache(maxsize=16)
def _ratio_of_slopes(threshold: int, dark_counts: float) -> Array:
    """Return the derivative of log p by the logarithm of the light, relative to threshold 1.

    It is computed at some z. The contrast at others is interpolated. It is at least 1: with
    threshold 1, dark counts hide the contrast of the light as well.
    """
    p = np.minimum(squared_sine(_NODES), _MAX_PROBABILITY)
    rate = inverse_detection_probability(threshold, p, 1 - p)
    of_threshold_1 = inverse_detection_probability(1, p, 1 - p) * (1 - p)
    ratio = (rate - dark_counts) * detection_density(threshold, rate) / of_threshold_1
    return np.asarray(np.maximum(ratio, 1))


NO_CONTRAST = Contrast(1, 0.0)
"""The contrast of bits with threshold 1."""
