"""The layers of a color network: a U-Net that corrects classical colors."""

import numpy as np
import numpy.typing as npt

from jotlight.networks.architectures import (
    Builder,
    add_head,
    add_unet,
    find_architecture,
    fit_probability,
    with_sets,
)
from jotlight.networks.color_planes import CENTER, PLANES, START
from jotlight.networks.layer import Layer
from jotlight.networks.splines import Spline, fit_spline

COLORS = 3
"""Red, green, and blue."""


def build_color(name: str, rng: np.random.Generator) -> list[Layer]:
    """Return the layers of an untrained color network.

    They map the planes of :mod:`jotlight.networks.color_planes` to P(b = 1) of red, green, and
    blue. Before training, these are the classical estimate.

    Parameters
    ----------
    name : str
        Size of the U-Net: one of :data:`jotlight.networks.architectures.ARCHITECTURES`.
    rng : numpy.random.Generator
        Draws the filters.
    """
    taps: npt.NDArray[np.float32] = np.zeros((COLORS, PLANES, 1, 1), np.float32)
    taps[range(COLORS), range(PLANES)[START]] = 1
    shift = _each_color(fit_spline(lambda z: z + CENTER, -CENTER, CENTER, 4))
    planes = Layer(np.ones((PLANES, 1, 1, 1), np.float32), None, trainable="nothing")
    builder = Builder([planes, Layer(taps, *shift, trainable="nothing")], rng)
    add_unet(builder, find_architecture(name), source=0)
    probability = _each_color(fit_probability())
    return [with_sets(layer) for layer in add_head(builder, probability, skip=1)]


def _each_color(spline: Spline) -> Spline:
    """Return a spline for each color."""
    coefficients, low, spacing = spline
    return np.repeat(coefficients, COLORS, axis=0), low, spacing
