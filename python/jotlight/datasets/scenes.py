"""Scenes that need no download: photographs of scikit-image, and synthetic scenes."""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from jotlight.images.color import luma
from jotlight.parameter_names import check_choice, takes_rng
from jotlight.seeds import random_generator

PHOTOGRAPHS = ("camera", "coins", "moon", "astronaut", "coffee", "chelsea", "rocket")
"""Names of photographs of scikit-image: three in gray, then four in color."""


def photograph(name: str = "camera", *, gray: bool = False) -> npt.NDArray[np.float32]:
    """Return a photograph of scikit-image with intensities in [0, 1].

    Parameters
    ----------
    name : str
        One of :data:`PHOTOGRAPHS`.
    gray : bool
        Whether to convert color to gray (:func:`jotlight.images.color.luma`).

    Returns
    -------
    ndarray of float32, shape (H, W) or (H, W, 3)
        Levels divided by 255. They are display-encoded, not linear in light.

    Examples
    --------
    >>> photograph().shape, photograph("coffee", gray=True).shape
    ((512, 512), (400, 600))
    """
    check_choice("photograph", name, PHOTOGRAPHS)
    photo = np.asarray(_levels(name), np.float32) / np.float32(255)
    return luma(photo).astype(np.float32) if gray and photo.ndim == 3 else photo


@functools.cache
def _levels(name: str) -> npt.NDArray[np.uint8]:
    import skimage.data

    levels: npt.NDArray[np.uint8] = getattr(skimage.data, name)()
    return levels


@takes_rng
def uniform_scene(
    shape: tuple[int, ...] = (32, 32), rng: int | np.random.Generator | None = None
) -> npt.NDArray[np.float32]:
    """Return the paper's synthetic scene: independent intensities, uniform in [0, 1].

    Examples
    --------
    >>> uniform_scene((2, 3), rng=0).shape
    (2, 3)
    """
    return random_generator(rng).random(shape, np.float32)


def uniform_scenes(rng: np.random.Generator, number: int) -> npt.NDArray[np.float32]:
    """Return `number` synthetic scenes of 32 x 32 pixels for :func:`jotlight.train`.

    Examples
    --------
    >>> uniform_scenes(np.random.default_rng(0), 5).shape
    (5, 32, 32)
    """
    return uniform_scene((number, 32, 32), rng)
