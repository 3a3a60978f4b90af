"""The layers of networks for planes: a U-Net that corrects an estimate in some of the planes.

All planes with estimates or counts hold z = arcsin √p, whose noise has the standard deviation
1/(2 √K) at every exposure, or differences of z.
"""

from collections.abc import Sequence

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
from jotlight.networks.layer import Layer
from jotlight.networks.splines import Spline, fit_spline

CENTER = np.pi / 4
"""The middle of the range of z, which is subtracted from the estimate."""


def build_correction(
    name: str, planes: int, start: Sequence[int], rng: np.random.Generator
) -> list[Layer]:
    """Return the layers of an untrained network for planes.

    Before training, its outputs are P(b = 1) of the estimate that it corrects.

    Parameters
    ----------
    name : str
        Size of the U-Net: one of :data:`jotlight.networks.architectures.ARCHITECTURES`.
    planes : int
        Number of planes.
    start : sequence of int
        The planes of the estimate, one for each output: z, minus its center.
    rng : numpy.random.Generator
        Draws the filters.
    """
    outputs = len(start)
    taps: npt.NDArray[np.float32] = np.zeros((outputs, planes, 1, 1), np.float32)
    taps[range(outputs), start] = 1
    shift = _for_each(outputs, fit_spline(lambda z: z + CENTER, -CENTER, CENTER, 4))
    first = Layer(np.ones((planes, 1, 1, 1), np.float32), None, trainable="nothing")
    builder = Builder([first, Layer(taps, *shift, trainable="nothing")], rng)
    add_unet(builder, find_architecture(name), source=0)
    probability = _for_each(outputs, fit_probability())
    return [with_sets(layer) for layer in add_head(builder, probability)]


def _for_each(outputs: int, spline: Spline) -> Spline:
    """Return a spline for each output."""
    coefficients, low, spacing = spline
    return np.repeat(coefficients, outputs, axis=0), low, spacing
