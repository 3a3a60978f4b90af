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
from jotlight.networks.graph import size_divisor
from jotlight.networks.layer import Layer
from jotlight.sensing.bits import Bits
from jotlight.sensing.bits_checks import check_fits
from jotlight.sensing.output_images import OutputImages
from jotlight.sensing.pixel_counts import GrayImages, PixelCounts, describe_pixels
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
    rotations: int = 1
    """Over how many rotations of the data by 90 degrees a tied network averages its output."""

    def run(self, images: GrayImages, output: OutputImages) -> npt.NDArray[np.float32]:
        """Return the output of the last layer, shape (N, H, W), as the images of `output`.

        Raises
        ------
        TypeError
            When an untied network gets counts.
        ValueError
            When the data do not fit the sensor, or an untied network gets a sensor whose jots
            differ from its own.
        """
        if self.layers[0].shape[1:] != (1, 1, 1):
            return self._run_untied(images, output)
        bits = bits_alike(images, self.sensor) if self.rotations == 1 else None
        if bits is not None:
            return self.run_bits(bits, self.sensor.trials, output)
        pixels = images.count(self.sensor, self.threads)
        return self.run_pixels(pixels, self.sensor.trials, output)

    def run_pixels(
        self, pixels: PixelCounts, trials: int, output: OutputImages
    ) -> npt.NDArray[np.float32]:
        """Return the output of a tied network for K = `trials`, shape (N, H, W)."""
        if self.rotations == 1 and pixels.uniform and pixels.trials < pixels.counts.size:
            table = self._table(pixels, trials)
            arguments = self._engine_layers, pixels.counts, table
            engine.forward_counts(*arguments, list(output.images), self.threads)
            return output.images
        counts = equivalent_counts(pixels, self.reference, trials, self.threads)
        self._run_tied(counts, list(output.images))
        return output.images

    def run_bits(
        self, bits: Sequence[Bits], trials: int, output: OutputImages
    ) -> npt.NDArray[np.float32]:
        """Return the output of a tied network for the bits of :func:`bits_alike`, (N, H, W).

        The engine counts the bits where it needs the counts. So an array of them is not necessary.
        """
        one = describe_pixels(np.zeros((1, 1, 1), np.int32), self.sensor)
        table, side = self._table(one, trials), self.sensor.oversampling
        packed = [np.asarray(each.packed) for each in bits]
        places = list(output.images)
        layers, width = self._engine_layers, bits[0].width
        engine.forward_tied_bits(layers, packed, width, side, table, places, self.threads)
        return output.images

    def run_counts(self, counts: Iterable[npt.NDArray[np.float32]]) -> list[Image]:
        """Return the outputs of a tied network for equivalent counts of reference jots.

        Each image has the shape (H, W). They may differ in size.
        """
        images = list(counts)
        out = [np.empty(image.shape, np.float32) for image in images]
        self._run_tied(images, out)
        return out

    def _run_tied(self, counts: Iterable[Image], out: list[Image]) -> None:
        """Write the outputs of a tied network for images of counts (H, W)."""
        if self.rotations == 1:
            self._run_sums([self._tied_weights[:, None] * image for image in counts], out)
            return
        # So strides meet the same pixels in the rotation of a part as in that of the whole image.
        divisor = size_divisor(self.layers)
        images = [pad_to_multiple(image, divisor) for image in counts]
        alone, means = dataclasses.replace(self, rotations=1), [np.zeros_like(x) for x in images]
        for turn in range(self.rotations):
            parts = alone.run_counts(np.rot90(image, turn) for image in images)
            for mean, part in zip(means, parts, strict=True):
                place = np.rot90(mean, turn)  # a view
                place += part / np.float32(self.rotations)
        for image, mean in zip(out, means, strict=True):
            image[:] = mean[: image.shape[0], : image.shape[1]]

    def _table(self, pixels: PixelCounts, trials: int) -> Image:
        """Return p for each count L of pixels alike, (C, K + 1)."""
        counts = np.arange(int(np.max(pixels.trials)) + 1, dtype=np.int32)
        all_counts = dataclasses.replace(pixels, counts=counts)
        table = equivalent_counts(all_counts, self.reference, trials, self.threads)
        return np.asarray(self._tied_weights * table)

    def _run_untied(self, images: GrayImages, output: OutputImages) -> Image:
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
        # Memory may not hold the frames of all captures in files.
        number = max(1, _MAX_BYTES // math.prod(bits[0].packed.shape))
        for start in range(0, len(bits), number):
            part = bits[start : start + number]
            places = list(output.images[start : start + number])
            if sensor.mask is not None and sensor.mask.any():
                self._run_sums(self._masked_sums(part, sensor.mask), places)
            else:
                # Frames that are read from files become an array here.
                packed = [each.packed[:, : each.shape[1]] for each in part]
                arguments = self._engine_layers, packed, bits[0].width
                engine.forward_bits(*arguments, places, self.threads)
        if sensor.mask is not None:
            dead = Bits.from_array(~sensor.mask).counts(sensor.oversampling) == 0
            warn_about_dead_pixels(np.broadcast_to(dead, (len(bits), *dead.shape)))
        return output.images

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

    def _run_sums(self, sums: list[npt.NDArray[np.float32]], out: list[Image]) -> None:
        """Write the outputs for p of each image, (C, H, W).

        p is the first layer's value before its splines.
        """
        engine.forward(self._engine_layers, sums, [image[None] for image in out], self.threads)

    @property
    def _tied_weights(self) -> npt.NDArray[np.float32]:
        """The weights of a tied first layer, shape (C, 1)."""
        return self.layers[0].filters.reshape(-1, 1)

    @property
    def _engine_layers(self) -> list[engine.Layer]:
        return [layer.engine_layer for layer in self.layers]


def pad_to_multiple(image: Image, divisor: int) -> Image:
    """Return an image (H, W) with mirrored rows and columns appended, up to multiples of a number.

    Examples
    --------
    >>> pad_to_multiple(np.ones((3, 8), np.float32), 4).shape
    (4, 8)
    """
    extra = [(0, -size % divisor) for size in image.shape]
    return np.pad(image, extra, "symmetric")


def bits_alike(images: GrayImages, sensor: Sensor) -> Sequence[Bits] | None:
    """Return bits in memory of which only the number of ones of each pixel matters.

    Return None for other data, for sensors with maps, and for more trials than pixels, because a
    table of all counts would be larger than the images.
    """
    for each in images.data:
        if not (isinstance(each, Bits) and isinstance(each.packed, np.ndarray)):
            return None
        check_fits(each.shape, sensor)
    bits = cast(Sequence[Bits], images.data)
    pixels = len(bits) * bits[0].shape[1] * bits[0].shape[2] // sensor.oversampling**2
    are_alike = not sensor.maps() and len({each.shape for each in bits}) == 1
    return bits if are_alike and sensor.trials < pixels else None
