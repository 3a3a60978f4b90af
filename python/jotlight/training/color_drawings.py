"""Synthetic patches in color, for color networks."""

from collections.abc import Callable

import numpy as np

from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.training.patch_sources import Patch, PatchSource
from jotlight.training.random_mosaics import random_mosaic
from jotlight.training.synthetic_patches import SyntheticPatches

_GRAY = 3 / 4
"""Fraction of the drawings that stay gray. Fine gray stripes teach that they are not colors."""

_BLACK_OR_WHITE = 1 / 2
"""Fraction of the colored drawings in which one of the two colors is black or white."""

_FINE = 1 / 2
"""Fraction of fine drawings."""


class ColorDrawings(PatchSource):
    """Random drawings as those of :class:`SyntheticPatches`, with two colors for 0 and 1.

    Three quarters stay gray, and half are fine drawings.

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
        return f"{type(self).__name__} {name} {self._gray.fingerprint()}"
