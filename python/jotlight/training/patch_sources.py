"""Sources of training patches: images, functions that generate images, and mixtures of sources."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.training.images import (
    ImageGenerator,
    Images,
    TrainingImages,
    check_images,
    describe_smallest,
    fingerprint_images,
    generate_images,
)


class Patch(NamedTuple):
    """A square part of an image."""

    values: npt.NDArray[np.float32]
    """Intensities (H, W), or those of red, green, and blue, (3, H, W)."""
    image_mean: float
    """Mean intensity of the whole image, which decides its exposure."""
    mosaic: Mosaic | None = None
    """Color filters of the pixels, or None for a gray patch and for color channels."""


class PatchSource(ABC):
    """A source of random patches for :func:`jotlight.torch.train`."""

    max_side: int
    """Largest height and width of a patch, in pixels."""

    @abstractmethod
    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random patch of `side` × `side` pixels; `side` is 1 to `max_side`."""

    @abstractmethod
    def fingerprint(self) -> str:
        """Return a digest or a description that identifies the source in a checkpoint."""

    def describe_limit(self) -> str:
        """Return a sentence about `max_side`, for the error message about a larger patch."""
        return f"The source has patches of at most {self.max_side} pixels"


class ImagePatches(PatchSource):
    """Random cutouts of images, randomly rotated and mirrored.

    Parameters
    ----------
    images : array (N, H, W) or sequence of arrays (H, W)
        Gray images of intensities. All are equally probable.

    Raises
    ------
    TypeError, ValueError
        When an image is not gray, or has intensities that are negative or not finite.

    Examples
    --------
    >>> source = ImagePatches([np.full((20, 30), 0.5)])
    >>> source.max_side, source.draw(np.random.default_rng(0), 8).values.shape
    (20, (8, 8))
    """

    def __init__(self, images: npt.ArrayLike | Sequence[npt.ArrayLike]) -> None:
        self.images: Images = check_images(images)
        self.max_side = min(min(image.shape) for image in self.images)
        self._means = [float(image.mean()) for image in self.images]

    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random patch."""
        index = int(rng.integers(len(self.images)))
        image = self.images[index]
        return Patch(_random_symmetry(rng, _random_cutout(rng, image, side)), self._means[index])

    def fingerprint(self) -> str:
        """Return a digest of the images."""
        return fingerprint_images(self.images)

    def describe_limit(self) -> str:
        """Return a sentence about the smallest image."""
        return describe_smallest(self.images)


class GeneratedPatches(PatchSource):
    """Random cutouts of images that a function generates, randomly rotated and mirrored.

    Parameters
    ----------
    make : callable
        Function of a random generator and a number N that returns N new images, (N, H, W). The
        first of them states the largest patch, so the others must not be smaller.

    Examples
    --------
    >>> source = GeneratedPatches(lambda rng, number: rng.random((number, 16, 16)))
    >>> source.draw(np.random.default_rng(0), 8).values.shape
    (8, 8)
    """

    def __init__(self, make: ImageGenerator) -> None:
        self._make = make
        self.max_side = min(generate_images(make, np.random.default_rng(0), 1)[0].shape)

    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random patch of a new image.

        Raises
        ------
        TypeError, ValueError
            When the function returns anything but an image that contains the patch.
        """
        image = generate_images(self._make, rng, 1)[0]
        height, width = image.shape
        if min(height, width) < side:
            raise ValueError(
                f"images: expected a callable of images of at least {side} x {side} pixels, the "
                f"size of a patch, got {height} x {width}; return larger images, or pass a smaller "
                "patch="
            )
        mean = float(image.mean())
        return Patch(_random_symmetry(rng, _random_cutout(rng, image, side)), mean)

    def fingerprint(self) -> str:
        """Return the name of the function."""
        return fingerprint_images(self._make)


class PatchMixture(PatchSource):
    """A mixture of sources: each patch comes from a source that is chosen by its weight.

    Parameters
    ----------
    weights : sequence of (PatchSource, float)
        Sources and their weights above 0. A weight is proportional to the number of patches.

    Raises
    ------
    TypeError, ValueError
        When there is no source, another object in its place, or a weight that is not a finite
        number above 0.

    Examples
    --------
    >>> dark, bright = (ImagePatches([np.full((9, 9), level)]) for level in (0.1, 0.9))
    >>> source = PatchMixture([(dark, 4), (bright, 1)])
    >>> rng = np.random.default_rng(0)
    >>> levels = [source.draw(rng, 4).image_mean for _ in range(1000)]
    >>> round(float(np.mean(np.array(levels) < 0.5)), 1)
    0.8
    """

    def __init__(self, weights: Sequence[tuple[PatchSource, float]]) -> None:
        if not weights:
            raise ValueError("weights: expected at least one source and its weight, got none")
        if not all(0 < weight < np.inf for _, weight in weights):
            received = [weight for _, weight in weights]
            raise ValueError(f"weights: expected finite numbers above 0, got {received}")
        self._sources = [source for source, _ in weights]
        if not all(isinstance(source, PatchSource) for source in self._sources):
            names = ", ".join(type(source).__name__ for source in self._sources)
            raise TypeError(
                "weights: expected sources of patches, such as ImagePatches(images), and their "
                f"weights, got {names}"
            )
        cumulative = np.cumsum([weight for _, weight in weights])
        self._bounds = cumulative / cumulative[-1]
        self.max_side = min(source.max_side for source in self._sources)

    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random patch of a random source."""
        index = int(np.searchsorted(self._bounds, rng.random(), side="right"))
        return self._sources[index].draw(rng, side)

    def fingerprint(self) -> str:
        """Return a digest of the sources and of their weights."""
        digest = hashlib.sha256(self._bounds.tobytes())
        for source in self._sources:
            digest.update(source.fingerprint().encode())
        return digest.hexdigest()

    def describe_limit(self) -> str:
        """Return the sentence of the source with the smallest patches."""
        return min(self._sources, key=lambda source: source.max_side).describe_limit()


def as_patch_source(images: TrainingImages | PatchSource) -> PatchSource:
    """Return the source of patches of images, of a function that generates images, or of a source.

    Raises
    ------
    TypeError, ValueError
        When the images are not gray images of intensities.

    Examples
    --------
    >>> type(as_patch_source(np.ones((2, 9, 9)))).__name__
    'ImagePatches'
    """
    if isinstance(images, PatchSource):
        return images
    return GeneratedPatches(images) if callable(images) else ImagePatches(images)


def apply_symmetry(patch: npt.NDArray[np.float32], symmetry: int) -> npt.NDArray[np.float32]:
    """Return the patch under one of the eight symmetries of a square, 0 to 7.

    Examples
    --------
    >>> apply_symmetry(np.array([[1, 2], [3, 4]], np.float32), 1).tolist()
    [[2.0, 4.0], [1.0, 3.0]]
    """
    patch = np.rot90(patch, symmetry % 4)
    return patch.T if symmetry >= 4 else patch


def _random_symmetry(
    rng: np.random.Generator, patch: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    return apply_symmetry(patch, int(rng.integers(8)))


def _random_cutout(
    rng: np.random.Generator, image: npt.NDArray[np.float32], side: int
) -> npt.NDArray[np.float32]:
    y, x = rng.integers(np.array(image.shape) - side + 1)
    return image[y : y + side, x : x + side]
