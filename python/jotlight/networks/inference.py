"""The output of a network for bits or counts of gray images."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.chunks import frame_chunks
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.estimators.inverse_response import equivalent_counts
from jotlight.networks.layer import Layer
from jotlight.sensing.bits import Bits, check_fits
from jotlight.sensing.pixel_counts import GrayData, GrayImages, PixelCounts
from jotlight.sensing.reference import Jot
from jotlight.sensing.sensor import Sensor

FLOPS_PER_BAND = 1 << 35
"""Number of operations in one call of the engine. Ctrl-C takes effect between calls."""

_MIN_BAND = 8
"""Minimum height of a band, in receptive fields. It bounds the fraction of rows computed twice."""


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
            outputs = [self._run_untied(image) for image in images.data]
            return np.stack(outputs) if len(outputs) > 1 else outputs[0][None]
        return self.run_pixels(images.count(self.sensor, self.threads), self.sensor.trials)

    def run_pixels(self, pixels: PixelCounts, trials: int) -> npt.NDArray[np.float32]:
        """Return the output of a tied network for K = `trials`, shape (N, H, W)."""
        if pixels.uniform and pixels.trials < pixels.counts.size:
            return self._run_by_table(pixels, trials)
        return self.run_counts(equivalent_counts(pixels, self.reference, trials, self.threads))

    def run_counts(self, counts: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return the output of a tied network for equivalent counts of reference jots.

        Both have the shape (N, H, W).
        """
        return self._run_sums(self._tied_weights[:, None] * counts[:, None])

    def _run_by_table(self, pixels: PixelCounts, trials: int) -> npt.NDArray[np.float32]:
        """Return the output of a tied network for pixels alike. A table maps each count L to p."""
        counts = np.arange(int(np.max(pixels.trials)) + 1, dtype=np.int32)
        all_counts = dataclasses.replace(pixels, counts=counts)
        table = equivalent_counts(all_counts, self.reference, trials, self.threads)
        table = self._tied_weights * table
        return engine.forward_counts(self._engine_layers, pixels.counts, table, self.threads)

    def _run_untied(self, data: GrayData) -> npt.NDArray[np.float32]:
        """Return the output of a network whose first layer has one weight per jot and frame."""
        if not isinstance(data, Bits):
            raise TypeError(
                f"data: expected Bits, because this network weighs each jot of a pixel, got "
                f"{type(data).__name__}; a tied network takes counts"
            )
        sensor = self.sensor
        check_fits(data, sensor)
        jots = sensor.efficiency, sensor.dark_counts
        if any(np.any(a != b) for a, b in zip(jots, self.reference, strict=True)):
            raise ValueError(
                "sensor: expected the network's efficiency and dark counts, the same for all jots; "
                "a tied network takes others"
            )
        if sensor.mask is not None and sensor.mask.any():
            sums = self._masked_sums(data, sensor.mask)
            return np.asarray(self._run_sums(sums[None])[0])
        # Frames that are read from files become an array here.
        packed = data.packed[:, : data.shape[1]]
        return engine.forward_bits(self._engine_layers, packed, data.width, self.threads)

    def _masked_sums(self, data: Bits, mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
        """Return p, shape (C, H, W), from the valid jots only. Dead pixels are inpainted."""
        first, side = self.layers[0], self.sensor.oversampling
        height, width = (size // side for size in data.shape[1:3])
        valid = np.packbits(~mask, axis=1)
        sums = np.empty((len(first.filters), height, width), np.float32)
        for _, rows in frame_chunks(1, height, width * first.filters.size):
            jots = slice(rows.start * side, rows.stop * side)
            sums[:, rows.start : rows.stop] = engine.masked_sums(
                first.engine_layer, data.packed[:, jots], data.width, valid[jots], self.threads
            )
        # A pixel without a valid jot is NaN in every channel.
        dead = np.isnan(sums[0])
        if dead.any():
            sums = np.stack([inpaint_dead_pixels(channel, dead) for channel in sums])
        return sums

    def _run_sums(self, sums: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return the output (N, H, W) for p, shape (N, C, H, W).

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
