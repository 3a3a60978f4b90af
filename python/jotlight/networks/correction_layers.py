"""The layers of a correction network: a U-Net that corrects a classical estimate."""

import numpy as np
import numpy.typing as npt

from jotlight.networks.architectures import (
    Builder,
    add_head,
    add_unet,
    find_architecture,
    with_sets,
)
from jotlight.networks.layer import Layer
from jotlight.networks.splines import Spline, fit_spline

CENTER = np.pi / 4
"""The middle of the range of z = arcsin √p, which is subtracted from the classical estimate."""

_FIT_COEFFICIENTS = 150
"""Number of coefficients of the last splines, which are sin² z."""


def build_correction(name: str, planes: int, start: slice, rng: np.random.Generator) -> list[Layer]:
    """Return the layers of an untrained correction network.

    They map planes to P(b = 1). Before training, these are the classical estimate.

    Parameters
    ----------
    name : str
        Size of the U-Net: one of :data:`jotlight.networks.architectures.ARCHITECTURES`.
    planes : int
        Number of planes.
    start : slice
        The planes of the classical estimate, z - π/4. There are as many outputs.
    rng : numpy.random.Generator
        Draws the filters.
    """
    places = range(planes)[start]
    outputs = len(places)
    taps: npt.NDArray[np.float32] = np.zeros((outputs, planes, 1, 1), np.float32)
    taps[range(outputs), places] = 1
    shift = _of_each(fit_spline(lambda z: z + CENTER, -CENTER, CENTER, 4), outputs)
    first = Layer(np.ones((planes, 1, 1, 1), np.float32), None, trainable="nothing")
    builder = Builder([first, Layer(taps, *shift, trainable="nothing")], rng)
    add_unet(builder, find_architecture(name), source=0)
    probability = fit_spline(lambda z: np.sin(z) ** 2, 0.0, np.pi / 2, _FIT_COEFFICIENTS)
    return [with_sets(layer) for layer in add_head(builder, _of_each(probability, outputs), skip=1)]


def _of_each(spline: Spline, outputs: int) -> Spline:
    """Return a spline for each output."""
    coefficients, low, spacing = spline
    return np.repeat(coefficients, outputs, axis=0), low, spacing
