"""Synthetic patches in color, for color networks."""

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.training.patch_sources import Patch, PatchSource
from jotlight.training.random_mosaics import random_mosaic
from jotlight.training.synthetic_patches import SyntheticPatches

_GRAY = 3 / 4
"""Fraction of the drawings that stay gray. Fine gray stripes teach that they are not colors."""

_BLACK_OR_WHITE = 1 / 2
"""Fraction of the colored drawings in which one of the two colors is black or white."""

_FINE = 1 / 2
"""Fraction of fine drawings, of those that are not the finest rings."""

_FINEST = 1 / 4
"""Fraction of the finest rings."""

_FROM_CORNER = 0.15
"""Largest difference of the frequency in the middle of these rings from a corner or a side of the
band, in cycles per pixel."""


class ColorDrawings(PatchSource):
    """Random drawings as those of :class:`SyntheticPatches`, with two colors for 0 and 1.

    Three quarters stay gray. A quarter are the finest rings, which look like colors behind a Bayer
    mosaic, and half of the others are fine drawings.

    Parameters
    ----------
    mosaics : callable, optional
        As for :class:`jotlight.training.ColorPatches`.

    Examples
    --------
    >>> patch = ColorDrawings().draw(np.random.default_rng(0), 48)
    >>> patch.values.shape, patch.mosaic is None
    ((3, 48, 48), False)
    """

    def __init__(
        self, mosaics: Callable[[np.random.Generator, int], Mosaic] | None = random_mosaic
    ) -> None:
        self.mosaics = mosaics
        self._gray = SyntheticPatches(fine=_FINE)
        self.max_side = self._gray.max_side

    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random drawing."""
        if rng.random() < _FINEST:
            values, mean = draw_finest_rings(rng, side), 0.5
        else:
            values, mean, _ = self._gray.draw(rng, side)
        first, last = np.zeros(3), np.ones(3)
        if rng.random() >= _GRAY:
            first, last = rng.random((2, 3))
            if rng.random() < _BLACK_OR_WHITE:
                first = np.full(3, float(rng.integers(2)))
        colors = first[:, None, None] + (last - first)[:, None, None] * values
        mosaic = None if self.mosaics is None else self.mosaics(rng, side)
        return Patch(colors.astype(np.float32), mean, mosaic)

    def fingerprint(self) -> str:
        """Return the names of the class and of the mosaics, and the fraction of fine drawings."""
        name = getattr(self.mosaics, "__name__", type(self.mosaics).__name__)
        return f"{type(self).__name__} {name} {_FINEST} {self._gray.fingerprint()}"


def draw_finest_rings(rng: np.random.Generator, side: int) -> npt.NDArray[np.float32]:
    """Return rings near half a cycle per pixel, sampled at points, `(side, side)`.

    At half a cycle, behind a Bayer mosaic, gray rows, columns, and checkerboards show the bits of a
    color. Around them, rings show alternating colors, by which a network can recognize them.
    """
    frequency = np.array([(0.5, 0.5), (0.5, 0.0), (0.0, 0.5)][rng.integers(3)])
    frequency += rng.uniform(-_FROM_CORNER, _FROM_CORNER, 2)
    slope = 2 ** rng.uniform(-10, -6)
    positions = np.arange(side) - (side - 1) / 2
    phase = [positions * (each + slope / 2 * positions) for each in frequency]
    wave = np.cos(2 * math.pi * (phase[0][:, None] + phase[1] + rng.random()))
    dark, bright = np.sort(rng.random(2)) if rng.random() < 1 / 2 else (0, 1)
    return np.asarray(dark + (bright - dark) * (wave + 1) / 2, np.float32)
