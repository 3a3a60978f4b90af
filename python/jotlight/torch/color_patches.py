"""Batches of color patches behind mosaics or in three channels, for color networks."""

from functools import cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from jotlight.networks.color.color_inference import (
    MIN_LARGEST,
    planes_of_channels,
    planes_of_mosaic,
)
from jotlight.networks.network import Network
from jotlight.networks.pretrained import COLOR_START, FOLDER
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.parameters.response import detection_probability
from jotlight.sensing.sensor import Sensor
from jotlight.torch.patches import PatchLoader
from jotlight.training.patch_sources import Patch


class ColorPatchLoader(PatchLoader):
    """A source of batches for a color network.

    Examples
    --------
    >>> from jotlight.training.color_patches import ColorPatches
    >>> network = jl.ColorNetwork.initial("small", rng=0)
    >>> source = ColorPatches([np.full((64, 64, 3), 99, np.uint8)])
    >>> loader = ColorPatchLoader(source, network, jl.Sensor(), seed=0, batch_size=2, side=32)
    >>> batch = loader.batch(step=0, shard=slice(None), threads=1)
    >>> batch.data.shape, batch.truth.shape
    (torch.Size([2, 11, 32, 32]), torch.Size([2, 3, 32, 32]))
    """

    extreme_fraction: ClassVar[float] = 1 / 3
    """As of the base class. With 1/16 of them, estimates of bright scenes were worse."""

    def expose_patch(
        self,
        patch: Patch,
        slope: np.float32,
        dark_counts: np.float64,
        trials: int,
        generator: np.random.Generator,
    ) -> npt.NDArray[np.float32]:
        """Return the planes that a color network reads of a patch, (11, H, W).

        The parameters are those of :meth:`jotlight.torch.patches.PatchLoader.expose_patch`, with a
        patch of :class:`jotlight.training.ColorPatches`.
        """
        if patch.values.ndim != 3:
            raise ValueError(
                "images: expected color patches (3, H, W) for a color network, such as those of "
                f"jotlight.training.ColorPatches, got shape {patch.values.shape}"
            )
        sensor = Sensor(
            frames=trials,
            gain=float(slope) * trials,
            dark_counts=float(dark_counts),
            max_intensity=MIN_LARGEST,
        )
        light: npt.NDArray[np.floating] = patch.values.astype(np.float64)
        if patch.mosaic is not None:
            light = patch.mosaic.light(light, channel_axis=0)
        probability = detection_probability(1, light * slope + dark_counts)
        counts = generator.binomial(trials, probability).astype(np.int32)
        if patch.mosaic is not None:
            counted = count_pixels(counts, sensor, 1)
            return planes_of_mosaic(_gray(), counted, patch.mosaic, threads=1)
        channels = [count_pixels(channel, sensor, 1) for channel in counts]
        return planes_of_channels(_gray(), channels, threads=1)


@cache
def _gray() -> Network:
    return Network.load(FOLDER / f"{COLOR_START}.safetensors")
