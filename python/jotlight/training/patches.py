"""What a network learns from: patches of images, seen anew by the sensor in every step."""

import dataclasses
import hashlib
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_image
from jotlight.seeds import seed_bytes
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor

Stack = npt.NDArray[np.float32]
Images = Stack | list[Stack]
"""Images of one size in one array (N, H, W), or of any size each."""

ImageGenerator = Callable[[np.random.Generator, int], npt.NDArray[np.floating]]
"""Makes so many new images (N, H, W) from a generator."""


@dataclasses.dataclass(frozen=True)
class PatchSampler:
    """TrainingImages, and how patches of them are taken and exposed.

    The patches and bits of a step depend on the seed and the number of the step alone.
    """

    images: Images | ImageGenerator
    sensor: Sensor
    seed: int
    patches: int
    """How many to a step."""
    side: int | None
    """Height and width of a patch; None for whole images."""
    border: int
    """Pixels along the rim of a patch that do not count, since the network sees past them."""

    def batch(self, step: int) -> dict[str, Any]:
        """Give the engine's description of the patches of a step."""
        choice = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(step, 0)))
        images = self.images
        if callable(images):
            images = generate_images(images, choice, self.patches)
            chosen = np.arange(len(images))
        else:
            chosen = choice.integers(len(images), size=self.patches)
        sizes = np.array([images[index].shape for index in chosen])
        sides = sizes if self.side is None else np.full_like(sizes, self.side)
        first = choice.integers(sizes - sides + 1)
        return self._described(images, chosen, first, first + sides, step)

    def whole_images(self) -> dict[str, Any]:
        """Give the engine's description of all images, whole, with bits of their own."""
        assert not callable(self.images)
        sizes = np.array([image.shape for image in self.images])
        return self._described(
            self.images, np.arange(len(sizes)), np.zeros_like(sizes), sizes, 2**32 - 1
        )

    def _described(
        self,
        images: Images,
        chosen: npt.NDArray[np.int64],
        first: npt.NDArray[np.int64],
        last: npt.NDArray[np.int64],
        step: int,
    ) -> dict[str, Any]:
        rows, columns = zip(first.T, last.T, strict=True)
        return {
            "sensor": self.sensor.engine_arguments(),
            "frames": self.sensor.frames,
            "images": images,
            "patches": np.stack([chosen, *rows, *columns], axis=1).astype(np.int64),
            "border": self.border,
            "seed": seed_bytes(np.random.SeedSequence(self.seed, spawn_key=(step, 1))),
        }

    def fingerprint(self) -> str:
        """Give a word that tells these images from others."""
        return fingerprint_images(self.images)


def fingerprint_images(images: Images | ImageGenerator) -> str:
    """Give a word that tells these images from others; of callables it is their name."""
    if callable(images):
        return getattr(images, "__qualname__", type(images).__qualname__)
    digest = hashlib.sha256()
    for image in images:
        digest.update(repr(image.shape).encode())
        digest.update(np.ascontiguousarray(image).data)
    return digest.hexdigest()


def patch_sensor(sensor: Sensor) -> Sensor:
    """Give the sensor without its maps: no jot dead, and the median of the others."""
    efficiency, dark = reference_jot(sensor)
    return sensor.replace(mask=None, efficiency=efficiency, dark_counts=dark)


def generate_images(source: ImageGenerator, rng: np.random.Generator, number: int) -> Images:
    """Have a source make images, and check them.

    Raises
    ------
    TypeError, ValueError
        When it makes something else, or another number.
    """
    made = source(rng, number)
    if not isinstance(made, np.ndarray) or made.ndim != 3 or len(made) != number:
        given = f"shape {made.shape}" if isinstance(made, np.ndarray) else type(made).__name__
        raise ValueError(
            f"images: expected the callable to give an array ({number}, H, W), got {given}"
        )
    return check_images(made)


def check_images(images: npt.ArrayLike | Sequence[npt.ArrayLike]) -> Images:
    """Check grey images of intensities, and bring them to float32.

    Raises
    ------
    TypeError, ValueError
        For no images, other than two dimensions, integers, negative and not finite intensities.
    """
    if isinstance(images, np.ndarray) and images.ndim != 3:
        raise ValueError(
            f"images: expected an array (N, H, W) or a sequence of images (H, W), got shape "
            f"{images.shape}; a single image goes in a list"
        )
    if len(images) == 0:  # type: ignore[arg-type]
        raise ValueError("images: expected at least one, got none")
    if isinstance(images, np.ndarray):
        # Checked as one tall image.
        flat = as_image(images.reshape(-1, images.shape[2])) if images.size else as_image(images)
        return np.require(flat, np.float32, ["C"]).reshape(images.shape)
    checked = []
    for index, image in enumerate(images):  # type: ignore[arg-type]
        array = as_image(image)
        if array.ndim != 2:
            raise ValueError(
                f"images: expected grey ones (H, W), got shape {array.shape} for number {index}; "
                "the network treats colour channels alike, so give them one by one"
            )
        checked.append(np.require(array, np.float32, ["C"]))
    return checked


def patch_size(images: Images, side: int | None) -> int:
    """Check the side of patches against the images; without one, 64 or what fits all of them.

    Raises
    ------
    ValueError
        When an image is smaller than the patch.
    """
    smallest = int(min(min(image.shape) for image in images))
    if side is None:
        return min(64, smallest)
    side = operator.index(side)
    if side < 1:
        raise ValueError(f"patch: expected at least 1 pixel, got {side}")
    if side > smallest:
        index, image = next((i, x) for i, x in enumerate(images) if min(x.shape) < side)
        raise ValueError(
            f"patch: expected at most the {smallest} pixels of the smallest image, got {side}; "
            f"image number {index} is {image.shape[0]} x {image.shape[1]}"
        )
    return side
