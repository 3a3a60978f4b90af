"""The output of a network for bits or counts of gray images."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.chunks import frame_chunks
from jotlight.estimators.inpaint import fill_dead_pixels, warn_about_dead_pixels
from jotlight.estimators.inverse_response import equivalent_counts
from jotlight.networks.layer import Layer
from jotlight.sensing.bits import Bits
from jotlight.sensing.bits_checks import check_fits
from jotlight.sensing.pixel_counts import GrayImages, PixelCounts
from jotlight.sensing.reference import Jot
from jotlight.sensing.sensor import Sensor

_MAX_BYTES = 1 << 28
"""Maximum number of bytes of the bits in one call, if they are those of several images."""

Image = npt.NDArray[np.float32]


@dataclasses.dataclass(frozen=True)
class Inference:
    """A network's forward pass on gray images."""

    layers: Sequence[Layer]
    sensor: Sensor
    """Sensor of the data."""
    reference: Jot
    """Efficiency and dark counts of the jots for which the layers were made."""
    threads: int | None

    def run(self, images: GrayImages) -> npt.NDArray[np.float32]:
        """Return the output of the last layer, shape (N, H, W).

        Raises
        ------
        TypeError
            When an untied network gets counts.
        ValueError
            When the data do not fit the sensor, or an untied network gets a sensor whose jots
            differ from its own.
        """
        if self.layers[0].shape[1:] != (1, 1, 1):
            return self._run_untied(images)
        return self.run_pixels(images.count(self.sensor, self.threads), self.sensor.trials)

    def run_pixels(self, pixels: PixelCounts, trials: int) -> npt.NDArray[np.float32]:
        """Return the output of a tied network for K = `trials`, shape (N, H, W)."""
        if pixels.uniform and pixels.trials < pixels.counts.size:
            return self._run_by_table(pixels, trials)
        counts = equivalent_counts(pixels, self.reference, trials, self.threads)
        return stack(self.run_counts(counts))

    def run_counts(self, counts: Iterable[npt.NDArray[np.float32]]) -> list[Image]:
        """Return the outputs of a tied network for equivalent counts of reference jots.

        Each image has the shape (H, W). They may differ in size.
        """
        sums = [self._tied_weights[:, None] * image for image in counts]
        return self._run_sums(sums)

    def _run_by_table(self, pixels: PixelCounts, trials: int) -> npt.NDArray[np.float32]:
        """Return the output of a tied network for pixels alike. A table maps each count L to p."""
        counts = np.arange(int(np.max(pixels.trials)) + 1, dtype=np.int32)
        all_counts = dataclasses.replace(pixels, counts=counts)
        table = equivalent_counts(all_counts, self.reference, trials, self.threads)
        table = self._tied_weights * table
        return stack(engine.forward_counts(self._engine_layers, pixels.counts, table, self.threads))

    def _run_untied(self, images: GrayImages) -> Image:
        """Return the output of a network whose first layer has one weight per jot and frame."""
        sensor = self.sensor
        for data in images.data:
            if not isinstance(data, Bits):
                raise TypeError(
                    f"data: expected Bits, because this network weighs each jot of a pixel, got "
                    f"{type(data).__name__}; a tied network takes counts"
                )
            check_fits(data.shape, sensor)
        jots = sensor.efficiency, sensor.dark_counts
        if any(np.any(a != b) for a, b in zip(jots, self.reference, strict=True)):
            raise ValueError(
                "sensor: expected the network's efficiency and dark counts, the same for all jots; "
                "a tied network takes others"
            )
        bits = cast(Sequence[Bits], images.data)
        outputs: list[Image] = []
        # Memory may not hold the frames of all captures in files.
        number = max(1, _MAX_BYTES // math.prod(bits[0].packed.shape))
        for start in range(0, len(bits), number):
            part = bits[start : start + number]
            if sensor.mask is not None and sensor.mask.any():
                outputs += self._run_sums(self._masked_sums(part, sensor.mask))
            else:
                # Frames that are read from files become an array here.
                packed = [each.packed[:, : each.shape[1]] for each in part]
                outputs += engine.forward_bits(
                    self._engine_layers, packed, bits[0].width, self.threads
                )
        if sensor.mask is not None:
            dead = Bits.from_array(~sensor.mask).counts(sensor.oversampling) == 0
            warn_about_dead_pixels(np.broadcast_to(dead, (len(bits), *dead.shape)))
        return stack(outputs)

    def _masked_sums(self, bits: Sequence[Bits], mask: npt.NDArray[np.bool_]) -> list[Image]:
        """Return p of each image, (C, H, W), from the valid jots. Dead pixels are inpainted."""
        first, side = self.layers[0], self.sensor.oversampling
        height, width = (size // side for size in mask.shape)
        valid = np.packbits(~mask, axis=1)
        sums = np.empty((len(bits), len(first.filters), height, width), np.float32)
        for _, rows in frame_chunks(1, height, len(bits) * width * first.filters.size):
            jots = slice(rows.start * side, rows.stop * side)
            packed = [each.packed[:, jots] for each in bits]
            sums[:, :, rows.start : rows.stop] = engine.masked_sums(
                first.engine_layer, packed, bits[0].width, valid[jots], self.threads
            )
        # A pixel without a valid jot is NaN in every channel.
        planes = sums.reshape(-1, height, width)
        return list(fill_dead_pixels(planes, np.isnan(planes)).reshape(sums.shape))

    def _run_sums(self, sums: list[npt.NDArray[np.float32]]) -> list[Image]:
        """Return the outputs for p of each image, (C, H, W).

        p is the first layer's value before its splines.
        """
        return engine.forward(self._engine_layers, sums, self.threads)

    @property
    def _tied_weights(self) -> npt.NDArray[np.float32]:
        """The weights of a tied first layer, shape (C, 1)."""
        return self.layers[0].filters.reshape(-1, 1)

    @property
    def _engine_layers(self) -> list[engine.Layer]:
        return [layer.engine_layer for layer in self.layers]


def stack(images: Sequence[Image]) -> Image:
    """Return images of the same size as one array (N, H, W). A single image is not copied.

    Examples
    --------
    >>> stack([np.zeros((2, 3), np.float32)] * 4).shape
    (4, 2, 3)
    """
    return images[0][None] if len(images) == 1 else np.stack(images)
