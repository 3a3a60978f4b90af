"""Patches of the training images, with new bits in every step."""

import dataclasses
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.checks import whole_number
from jotlight.networks.network import Network
from jotlight.networks.planes_network import PlanesNetwork
from jotlight.seeds import seed_bytes
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.parameters.intensity_scale import warn_about_scale
from jotlight.sensing.sensor import Sensor
from jotlight.training.images import (
    ImageGenerator,
    Images,
    TrainingImages,
    check_images,
    describe_smallest,
    generate_images,
)
from jotlight.training.patch_sources import PatchSource

_DEFAULT_PATCH = 64
"""Default height and width of a patch, in pixels."""

_SMOOTH_KERNEL_RADIUS = 2
"""Distance in pixels over which a smooth kernel brings light into a patch."""

_WHOLE_IMAGES_STEP = 2**32 - 1
"""Step number that seeds the bits of the test images. No step of a run has it."""


@dataclasses.dataclass(frozen=True)
class PatchSampler:
    """A source of random patches and of their bits.

    The patches and bits of a step depend only on the seed and the number of the step.
    """

    images: Images | ImageGenerator
    sensor: Sensor
    seed: int
    patches: int
    """Number of patches per step."""
    side: int | None
    """Height and width of a patch; None for whole images."""
    border: int
    """Width of the rim of a patch that the cost leaves out, because its estimate depends on pixels
    outside the patch. The cost includes the rim where it lies at the border of the image."""

    @classmethod
    def for_network(
        cls,
        network: Network,
        sensor: Sensor,
        images: TrainingImages,
        patch: int | None,
        batch: int | None,
        pixels: int,
        seed: int,
    ) -> Self:
        """Return the sampler for :func:`jotlight.train`, which documents most parameters.

        `pixels` is the number of pixels per step from which the default batch follows.

        Raises
        ------
        TypeError, ValueError
            When images, patch, batch, and network do not fit together.
        """
        if isinstance(images, PatchSource):
            raise TypeError(
                f"images: expected images or a callable, got {type(images).__name__}; pass the "
                "arrays, or train with jotlight.torch.train, which takes sources of patches"
            )
        sensor = patch_sensor(sensor)
        border = network.halo + (0 if sensor.kernel == "box" else _SMOOTH_KERNEL_RADIUS)
        batch = None if batch is None else whole_number("batch", batch, 1)
        if callable(images):
            if patch is not None:
                raise ValueError(
                    "patch: expected none for a callable, such as that of synthetic scenes, whose "
                    f"images are used whole, got {patch}"
                )
            if batch is None:
                sample = generate_images(images, np.random.default_rng(0), 1)[0]
                batch = max(1, pixels // sample.size)
            return cls(images, sensor, seed, batch, None, border)
        checked = check_images(images)
        warn_about_scale("images", checked, sensor.max_intensity)
        side = patch_size(checked, patch)
        if side <= 2 * border and any(max(image.shape) > side for image in checked):
            is_limited = min(min(image.shape) for image in checked) <= 2 * border
            advice = f". {describe_smallest(checked)}" if is_limited else ""
            raise ValueError(
                f"patch: expected more than {2 * border} pixels, got {side}: estimates depend on "
                f"pixels up to {border} away, so no pixel of the patch would count{advice}"
            )
        return cls(checked, sensor, seed, batch or max(1, pixels // side**2), side, border)

    def batch(self, step: int) -> dict[str, Any]:
        """Return the engine's description of the patches of a step."""
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
        return self._describe(images, chosen, first, first + sides, step)

    def whole_images(self, images: Images) -> dict[str, Any]:
        """Return the engine's description of whole images, with the same bits in every step."""
        sizes = np.array([image.shape for image in images])
        indices = np.arange(len(sizes))
        return self._describe(images, indices, np.zeros_like(sizes), sizes, _WHOLE_IMAGES_STEP)

    def _describe(
        self,
        images: Images,
        chosen: npt.NDArray[np.int64],
        first: npt.NDArray[np.int64],
        last: npt.NDArray[np.int64],
        step: int,
    ) -> dict[str, Any]:
        """Return the engine's description of the patches [first, last) of the chosen images."""
        rows, columns = zip(first.T, last.T, strict=True)
        return {
            "sensor": self.sensor.engine_arguments(),
            "frames": self.sensor.frames,
            "images": images,
            "patches": np.stack([chosen, *rows, *columns], axis=1).astype(np.int64),
            "border": self.border,
            "seed": seed_bytes(np.random.SeedSequence(self.seed, spawn_key=(step, 1))),
        }


def trained_sensor(network: Network | PlanesNetwork, sensor: Sensor | None) -> Sensor:
    """Return the sensor to train for: `sensor`, else that of `jl.pretrained`, else the network's.

    Examples
    --------
    >>> import jotlight as jl
    >>> trained_sensor(jl.pretrained(jl.Sensor(frames=16)), None)
    Sensor(frames=16)
    """
    default = network.default_sensor if isinstance(network, Network) else None
    return sensor or default or network.sensor


def patch_sensor(sensor: Sensor) -> Sensor:
    """Return the sensor for patches: maps become medians, and no jot is dead.

    Examples
    --------
    >>> patch_sensor(jl.Sensor(dark_counts=np.array([[0.25, 0.5], [0.25, 0.0]]))).dark_counts
    0.25
    """
    efficiency, dark_counts = reference_jot(sensor)
    return sensor.replace(mask=None, efficiency=efficiency, dark_counts=dark_counts)


def patch_size(images: Images, side: int | None) -> int:
    """Return the height and width of patches: `side`. By default, it is at most 64.

    Raises
    ------
    ValueError
        When an image is smaller than the patch.
    """
    smallest = int(min(min(image.shape) for image in images))
    if side is None:
        return min(_DEFAULT_PATCH, smallest)
    side = whole_number("patch", side, 1)
    if side > smallest:
        index, image = next((i, x) for i, x in enumerate(images) if min(x.shape) < side)
        raise ValueError(
            f"patch: expected at most the {smallest} pixels of the smallest image, got {side}; "
            f"image number {index} is {image.shape[0]} x {image.shape[1]}"
        )
    return side
