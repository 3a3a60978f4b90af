"""A network for films: it improves an image of a window with shorter exposures and the last image.

Bits that disagree with the motion of the scene are left out of the merged counts of a window, so
there are few of them where something moves in its own way. The bits of the last frames alone are
noisy, but hardly blurred. The last image contains bits from before the window. The network decides
for each pixel which of them to use.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.networks.correction_layers import CENTER
from jotlight.networks.correction_network import CorrectionNetwork

Image = npt.NDArray[np.float32]

SHARES = (1 / 16, 1 / 4, 1.0)
"""The parts of the window's frames whose bits are a plane each."""


class Exposure(NamedTuple):
    """What the pixels saw in some frames."""

    fraction: npt.NDArray[np.floating]
    """L/K, (H, W)."""
    trials: npt.NDArray[np.floating]
    """The number of bits of each pixel, (H, W)."""


class FilmNetwork(CorrectionNetwork):
    """A K-conditioned network that improves the images of a film.

    It reads the planes of :func:`film_planes`, (9, H, W), and returns P(b = 1), (1, H, W).

    Parameters
    ----------
    layers, history, trials_range
        See :class:`jotlight.networks.correction_network.CorrectionNetwork`.

    Examples
    --------
    >>> network = FilmNetwork.initial("small", rng=0)
    >>> network.planes
    9
    """

    planes, start, title = 9, slice(8, 9), "the estimate of merged counts"


def film_planes(
    start: Image, exposures: Sequence[Exposure], last: Image | None, trials: float
) -> Image:
    """Return the planes of an image of a film, (9, H, W).

    In the order of the planes, for each pixel they state

    - by how much z = arcsin √(L/K) of each of the three exposures deviates from the start, times
      its weight, and z of the last image, in four planes;
    - the weights, in four planes: the number of bits of a pixel, relative to the usual one of this
      exposure, at most 1. That of the last image is 1, or 0 where there is none;
    - z - π/4 of the start.

    Parameters
    ----------
    start : ndarray of float32, shape (H, W)
        P(b = 1), estimated from the merged counts of the window.
    exposures : sequence of Exposure
        The bits of the last sixteenth, of the last quarter, and of all frames of the window, along
        the motion of the scene.
    last : ndarray of float32, shape (H, W), optional
        P(b = 1) of the last image of the film, displaced by the motion. NaN marks pixels outside.
        Default: none.
    trials : float
        The usual number of bits of a pixel in all frames of the window.

    Examples
    --------
    >>> start = np.full((2, 2), 0.5, np.float32)
    >>> bits = [Exposure(np.full((2, 2), 0.25), np.full((2, 2), n)) for n in (1, 4, 8)]
    >>> film_planes(start, bits, None, trials=16)[:, 0, 0].round(3)
    array([-0.262, -0.262, -0.131,  0.   ,  1.   ,  1.   ,  0.5  ,  0.   ,
            0.   ], dtype=float32)
    """
    planes = np.zeros((FilmNetwork.planes, *start.shape), np.float32)
    z = _arcsin_root(start)
    for place, (share, exposure) in enumerate(zip(SHARES, exposures, strict=True)):
        usual = max(1.0, share * trials)
        weight = np.minimum(exposure.trials / usual, 1)
        planes[place] = weight * (_arcsin_root(exposure.fraction) - z)
        planes[4 + place] = weight
    if last is not None:
        known = np.isfinite(last)
        planes[3] = np.where(known, _arcsin_root(np.where(known, last, 0)) - z, 0)
        planes[7] = known
    planes[8] = z - CENTER
    return planes


def _arcsin_root(fraction: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    return np.asarray(np.arcsin(np.sqrt(np.clip(fraction, 0, 1))))
