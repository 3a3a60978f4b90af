"""Random mosaics, for the training of color networks."""

from collections.abc import Callable

import numpy as np

from jotlight.sensing.parameters.mosaic import Mosaic

_QUAD_BAYER = "RRGG/RRGG/GGBB/GGBB"
_X_TRANS = "GBGGRG/RGRBGB/GBGGRG/GRGGBG/BGBRGR/GRGGBG"

_CLEAR = 0.758
"""Fraction of clear pixels in the mosaic of SwissSPAD2, whose other pixels are random."""


def random_mosaic(rng: np.random.Generator, side: int) -> Mosaic:
    """Return a random mosaic of one of the kinds in `KINDS`.

    Parameters
    ----------
    rng : numpy.random.Generator
        Chooses the mosaic.
    side : int
        Height and width in pixels of the image behind it.

    Examples
    --------
    >>> random_mosaic(np.random.default_rng(2), 64)
    Mosaic('RGGB')
    """
    kinds, fractions = zip(*KINDS, strict=True)
    make: Callable[..., Mosaic] = kinds[rng.choice(len(kinds), p=fractions)]
    return make(rng, side)


def _shifted(*patterns: str) -> Callable[..., Mosaic]:
    """Return a function that chooses one of some patterns, and shifts it at random."""

    def make(rng: np.random.Generator, side: int) -> Mosaic:
        return _anywhere(Mosaic.of(patterns[rng.integers(len(patterns))]), rng)

    return make


def _anywhere(mosaic: Mosaic, rng: np.random.Generator) -> Mosaic:
    """Return a mosaic whose pattern is shifted and perhaps transposed at random."""
    pattern = np.roll(mosaic.pattern, rng.integers(mosaic.pattern.shape), (0, 1))
    pattern = pattern.T if rng.random() < 1 / 2 else pattern
    return Mosaic(pattern, mosaic.filters, mosaic.transmission)


def _scattered(rng: np.random.Generator, side: int) -> Mosaic:
    """Return a mosaic whose pixels are red, green, blue, or clear at random, as in SwissSPAD2."""
    clear = _CLEAR if rng.random() < 1 / 2 else rng.uniform(0.0, 0.8)
    shares = [*[(1 - clear) / 3] * 3, clear]
    return Mosaic(rng.choice(4, (side, side), p=shares).astype(np.uint8), "RGBW")


def _mixed(rng: np.random.Generator, side: int) -> Mosaic:
    """Return a Bayer mosaic whose filters also pass some light of other colors."""
    bayer = Mosaic.of("RGGB")
    own = bayer.transmission * rng.uniform(0.5, 1, (3, 1))
    others = (1 - bayer.transmission) * rng.uniform(0, 0.35, (3, 3))
    return _anywhere(Mosaic(bayer.pattern, bayer.filters, own + others), rng)


KINDS = [
    (_shifted("RGGB"), 0.74),
    (_shifted("RGBW"), 0.08),
    (_shifted(_QUAD_BAYER, _X_TRANS), 0.06),
    (_scattered, 0.08),
    (_shifted("CMYG", "CYYM"), 0.02),
    (_mixed, 0.02),
]
"""Functions that return a mosaic of some kind, and the fraction of each kind."""
