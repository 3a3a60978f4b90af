"""Patches of photographs in color, behind mosaics or in three channels, for color networks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.training.patch_sources import Patch
from jotlight.training.photographs import PhotographPatches, require_photographs
from jotlight.training.random_mosaics import random_mosaic

_TINTED, _LARGEST_TINT = 0.25, 0.7
"""Fraction of the patches whose colors are changed, and the largest logarithm of the factors."""


class ColorPatches(PhotographPatches):
    """Random patches of color photographs, (3, H, W), as :class:`PhotographPatches` cuts them.

    A quarter of them has random factors of red, green, and blue, and the channels in random order:
    sensors and lights have other colors than photographs. Each patch has its own mosaic.

    Parameters
    ----------
    photographs : sequence of uint8 arrays (H, W, 3)
        Display-encoded photographs. Gray ones are left out.
    mosaics : callable, optional
        ``mosaics(rng, side)`` returns the mosaic of a patch. Default:
        :func:`jotlight.training.random_mosaic`. None: no mosaics, but color channels, so that each
        pixel has three counts.
    linear, scaled, max_scale
        As for :class:`PhotographPatches`.

    Raises
    ------
    TypeError, ValueError
        When there is no color photograph, or as for :class:`PhotographPatches`.

    Examples
    --------
    >>> photograph = np.full((20, 30, 3), 51, np.uint8)
    >>> source = ColorPatches([photograph], linear=0.0)
    >>> source.draw(np.random.default_rng(0), 8).values.shape
    (3, 8, 8)
    """

    def __init__(
        self,
        photographs: Sequence[npt.NDArray[np.uint8]],
        *,
        mosaics: Callable[[np.random.Generator, int], Mosaic] | None = random_mosaic,
        linear: float = 0.1,
        scaled: float = 0.5,
        max_scale: float = 3.0,
    ) -> None:
        require_photographs(photographs)
        colors = [each for each in photographs if np.ndim(each) == 3]
        self.mosaics = mosaics
        super().__init__(colors, linear=linear, scaled=scaled, max_scale=max_scale)

    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random patch."""
        planes, means = self._photograph(int(rng.integers(len(self))))
        values, is_linear = self._cut(rng, planes[1:], side)
        if rng.random() < _TINTED:
            factors = np.exp(rng.uniform(-_LARGEST_TINT, _LARGEST_TINT, len(values)))
            values = (values * factors.astype(np.float32)[:, None, None])[rng.permutation(3)]
        mosaic = None if self.mosaics is None else self.mosaics(rng, side)
        return Patch(values, float(means[int(is_linear), 1:].mean()), mosaic)

    def fingerprint(self) -> str:
        """Return a digest that identifies the photographs, the settings, and the mosaics."""
        name = getattr(self.mosaics, "__name__", type(self.mosaics).__name__)
        return f"{super().fingerprint()} {name}"
