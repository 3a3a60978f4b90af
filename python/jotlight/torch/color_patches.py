"""Batches of color patches behind mosaics, for color networks."""

from functools import cache

import numpy as np
import numpy.typing as npt

from jotlight.networks.color_inference import planes_of_mosaic
from jotlight.networks.network import Network
from jotlight.networks.pretrained import CONDITIONAL_SIZE, FOLDER
from jotlight.sensing.mosaic import Mosaic
from jotlight.sensing.pixel_counts import count_pixels
from jotlight.sensing.response import detection_probability
from jotlight.sensing.sensor import Sensor
from jotlight.torch.patches import PatchLoader

_MOSAICS = {
    "RGGB": 0.85,
    "RGBW": 0.09,
    "RRGG/RRGG/GGBB/GGBB": 0.03,
    "GBGGRG/RGRBGB/GBGGRG/GRGGBG/BGBRGR/GRGGBG": 0.03,
}
"""Fractions of the patches behind each mosaic."""

_MAX_INTENSITY = 4.0
"""The largest intensity of the classical colors."""


class ColorPatchLoader(PatchLoader):
    """A source of batches for a color network. Each patch has its own mosaic.

    Examples
    --------
    >>> from jotlight.networks.color_network import ColorNetwork
    >>> from jotlight.training.color_patches import ColorPatches
    >>> network = ColorNetwork.initial("small", rng=0)
    >>> source = ColorPatches([np.full((64, 64, 3), 99, np.uint8)])
    >>> loader = ColorPatchLoader(source, network, Sensor(), seed=0, batch_size=2, side=32)
    >>> batch = loader.batch(step=0, shard=slice(None), threads=1)
    >>> batch.data.shape, batch.truth.shape
    (torch.Size([2, 11, 32, 32]), torch.Size([2, 3, 32, 32]))
    """

    def expose_patch(
        self,
        values: npt.NDArray[np.float32],
        slope: np.float32,
        dark_counts: np.float64,
        trials: int,
        generator: np.random.Generator,
    ) -> npt.NDArray[np.float32]:
        """Return the planes that a color network reads of a patch, (11, H, W).

        The parameters are those of :meth:`jotlight.torch.patches.PatchLoader.expose_patch`, with
        red, green, and blue of the patch, (3, H, W).
        """
        if values.ndim != 3:
            raise ValueError(
                "images: expected color patches (3, H, W) for a color network, such as those of "
                f"jotlight.training.ColorPatches, got shape {values.shape}"
            )
        mosaic = _draw_mosaic(generator)
        sensor = Sensor(
            frames=trials,
            gain=float(slope) * trials,
            dark_counts=float(dark_counts),
            max_intensity=_MAX_INTENSITY,
        )
        light = mosaic.light(np.moveaxis(values, 0, -1).astype(np.float64))
        probability = detection_probability(1, light * slope + dark_counts)
        counts = generator.binomial(trials, probability).astype(np.int32)
        counted = count_pixels(counts, sensor, 1)
        return planes_of_mosaic(_gray(), counted, sensor, mosaic, threads=1)


@cache
def _gray() -> Network:
    return Network.load(FOLDER / f"{CONDITIONAL_SIZE}.safetensors")


def _draw_mosaic(rng: np.random.Generator) -> Mosaic:
    """Return a random mosaic, whose pattern begins anywhere."""
    mosaic = Mosaic.of(rng.choice(list(_MOSAICS), p=list(_MOSAICS.values())))
    pattern = np.roll(mosaic.pattern, rng.integers(mosaic.pattern.shape), (0, 1))
    return Mosaic(pattern.T if rng.random() < 1 / 2 else pattern, mosaic.filters)
