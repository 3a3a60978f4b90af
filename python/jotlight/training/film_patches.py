"""Patches of the images of films, for film networks."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.networks.planes.film_planes import PLANES
from jotlight.training.patch_sources import Patch, PatchSource

_SIMILAR = 4
"""The patches of a step come from this many times as many images, of similar numbers of trials."""


@dataclasses.dataclass(frozen=True)
class FilmExample:
    """What a film network reads of an image, and the true image.

    Parameters
    ----------
    planes : ndarray of float
        The planes of :mod:`jotlight.networks.planes.film_planes`, (14, H, W).
    truth : ndarray of float
        The true intensities, (H, W).
    trials : float
        The usual number of binary readings behind a pixel of the window.
    light_per_intensity : float
        Photons per jot and frame at intensity 1.

    Raises
    ------
    ValueError
        When the planes do not fit the true image.
    """

    planes: npt.NDArray[np.floating]
    truth: npt.NDArray[np.floating]
    trials: float
    light_per_intensity: float

    def __post_init__(self) -> None:
        expected = PLANES, *self.truth.shape
        if self.planes.shape != expected:
            raise ValueError(f"planes: expected shape {expected}, got {self.planes.shape}")

    def cut(self, rng: np.random.Generator, side: int) -> FilmExample:
        """Return a random square part, randomly rotated and mirrored."""
        (y, x), symmetry = (
            rng.integers(np.array(self.truth.shape) - side + 1),
            int(rng.integers(8)),
        )

        def part(image: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
            square = image[..., y : y + side, x : x + side].astype(np.float32)
            square = np.moveaxis(square, (-2, -1), (0, 1))
            turned = np.rot90(square, symmetry % 4)
            turned = turned.swapaxes(0, 1) if symmetry >= 4 else turned
            return np.moveaxis(turned, (0, 1), (-2, -1))

        return dataclasses.replace(self, planes=part(self.planes), truth=part(self.truth))


class FilmPatches(PatchSource):
    """Random patches of images of films.

    Parameters
    ----------
    examples : sequence of FilmExample
        The images.

    Raises
    ------
    ValueError
        When there is no image.

    Examples
    --------
    >>> example = FilmExample(np.zeros((14, 20, 30)), np.full((20, 30), 0.5), 256.0, 0.4)
    >>> source = FilmPatches([example])
    >>> [each.planes.shape for each in source.draw_similar(np.random.default_rng(0), 8, 2)]
    [(14, 8, 8), (14, 8, 8)]
    """

    def __init__(self, examples: Sequence[FilmExample]) -> None:
        if not examples:
            raise ValueError("examples: expected at least one, got none")
        self.examples = sorted(examples, key=lambda each: each.trials)
        self.max_side = min(min(each.truth.shape) for each in self.examples)

    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random patch of a true image."""
        (example,) = self.draw_similar(rng, side, 1)
        return Patch(np.asarray(example.truth, np.float32), float(example.truth.mean()))

    def draw_similar(self, rng: np.random.Generator, side: int, number: int) -> list[FilmExample]:
        """Return random patches of images whose pixels have similar numbers of trials."""
        among = min(_SIMILAR * number, len(self.examples))
        middle = int(rng.integers(len(self.examples)))
        # Runs at the ends are cut, so images with the fewest trials are as frequent as others.
        nearby = middle + rng.integers(-(among // 2), among // 2 + 1, size=number)
        chosen = np.clip(nearby, 0, len(self.examples) - 1)
        return [self.examples[index].cut(rng, side) for index in chosen]

    def fingerprint(self) -> str:
        """Return a digest of the images."""
        digest = hashlib.sha256()
        for each in self.examples:
            digest.update(np.array([each.trials, each.light_per_intensity]).tobytes())
            digest.update(str(each.truth.shape).encode())
            for image in (each.planes, each.truth):
                digest.update(np.ascontiguousarray(image).tobytes())
        return digest.hexdigest()
