"""The image of a network for bits or counts of gray images."""

import dataclasses
import math
from collections.abc import Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.checks import check_threads
from jotlight.chunks import frame_chunks
from jotlight.errors import hide_warnings
from jotlight.estimators.inpaint import fill_dead_pixels, warn_about_dead_pixels
from jotlight.estimators.inverse_response import equivalent_counts
from jotlight.estimators.readings.merge_near import merge_different_jots
from jotlight.estimators.trial_levels import LocalTrials, count_local_trials
from jotlight.layout import Layout
from jotlight.networks.inference.coarse_scales import (
    add_coarse,
    counts_of_squares,
    has_few_photons,
    sensor_of_squares,
)
from jotlight.networks.inference.engine_backed import GrayNetwork, sensor_model
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.bits.output_images import OutputImages
from jotlight.sensing.bits.values import check_any_valid
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import MAX_PIXELS, GrayImages, PixelCounts
from jotlight.sensing.likelihood.reference import Jot, reference_jot, typical_jot
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

_MAX_BYTES = 1 << 28
"""Maximum number of bytes of the bits in one call, if they are those of several images."""


@dataclasses.dataclass(frozen=True)
class Inference:
    """Gray images that a network estimates from the data of one sensor."""

    network: GrayNetwork
    images: GrayImages
    """The bits or the counts of each image."""
    sensor: Sensor
    """The sensor of the data."""
    output: OutputImages
    """Where the intensities are written, (N, H, W)."""
    threads: int | None
    """The number of threads. Default: the number of cores."""

    def run(self) -> Image:
        """Return the intensities in [0, S], (N, H, W): the images of `output`.

        The engine runs the network once for images with the same number of trials, if it serves
        them. Other images take several levels of K: those with a map of trials, and those with more
        trials than the network was trained for. It also combines trials of dim scenes, corrects
        dark regions, and looks at squares of pixels, unless the pixels of an image differ.

        Raises
        ------
        TypeError
            When an untied network gets counts.
        ValueError
            When the data do not fit the sensor, or an untied network gets a sensor whose jots
            differ from its own.
        """
        check_threads(self.threads)
        if not self.network.tied:
            self._run_untied()
        elif self.network.trials_range is None:
            self._run_tied()
        else:
            images, sensor = merge_different_jots(self.images, self.sensor, self.threads)
            alike = dataclasses.replace(self, images=images, sensor=sensor)
            alike._run_tied()
        return self.output.images

    def _run_tied(self) -> None:
        """Write the intensities of a network that takes counts."""
        places = list(self.output.images)
        bits = self._bits_alike()
        if bits is not None:
            # The engine counts the bits where it needs the counts, so that it needs no array.
            self._run_on_bits([np.asarray(each.packed) for each in bits], bits[0].width, places)
            return
        pixels = self.images.count(self.sensor, self.threads)
        check_any_valid(pixels.trials)
        if self.network.trials_range is not None:
            pixels = _with_typical_sensor(pixels)
        if not pixels.uniform:
            self._run_different(pixels)
            return
        jot, trials = (pixels.efficiency, pixels.dark_counts), cast(float, pixels.trials)
        self.network.engine_network.counts(
            pixels.counts,
            trials,
            cast(Jot, jot),
            sensor_model(pixels.sensor),
            places,
            self.threads,
        )

    def _bits_alike(self) -> Sequence[Bits] | None:
        """Return bits in memory of which only the number of ones of each pixel matters.

        Return None for other data, and for sensors with maps.
        """
        for each in self.images.data:
            if not (isinstance(each, Bits) and isinstance(each.packed, np.ndarray)):
                return None
            check_fits(each.shape, self.sensor)
        bits = cast(Sequence[Bits], self.images.data)
        are_alike = not self.sensor.maps() and len({each.shape for each in bits}) == 1
        return bits if are_alike else None

    def _run_on_bits(
        self, packed: list[npt.NDArray[np.uint8]], width: int, places: list[Image]
    ) -> None:
        """Write the intensities of packed bits, without a map or a mask."""
        side, model = self.sensor.oversampling, sensor_model(self.sensor)
        self.network.engine_network.bits(packed, width, side, model, places, self.threads)

    def _run_different(self, pixels: PixelCounts) -> None:
        """Write the intensities of pixels that differ in their trials or their jots."""
        network, sensor = self.network, pixels.sensor
        trials: list[LocalTrials] = [sensor.trials] * len(pixels.counts)
        # Both sensors detect equal light at intensity 1.
        reference = Jot(reference_jot(sensor).efficiency, reference_jot(network.sensor).dark_counts)
        smallest = largest = sensor.trials
        if network.trials_range is not None:
            trials, reference = count_local_trials(pixels, self.threads), reference_jot(sensor)
            smallest, largest = network.trials_range
        # The network takes counts of its own K, and fractions of ones where it runs at several K.
        levels = [
            each if isinstance(each, int) and smallest <= each <= largest else 1 for each in trials
        ]
        values = equivalent_counts(pixels, reference, np.array(levels, np.float64), self.threads)
        number = max(1, MAX_PIXELS // values[0].size)
        for start in range(0, len(values), number):
            part = slice(start, start + number)
            network.engine_network.equivalent_counts(
                values[part],
                levels[part],
                trials[part],
                sensor_model(sensor),
                list(self.output.images[part]),
                self.threads,
            )
        if network.trials_range is not None:
            self._add_squares(pixels)

    def _add_squares(self, pixels: PixelCounts) -> None:
        """Correct the coarse structure of images with few photons by squares of their pixels."""
        data, found = self.images.data, self.output.images
        usual = [
            float(np.mean(each.trials)) if isinstance(each, Merged) else self.sensor.trials
            for each in data
        ]
        few = [
            index
            for index, (image, trials) in enumerate(zip(found, usual, strict=True))
            if has_few_photons(image, self.sensor, trials)
        ]
        squares = counts_of_squares(pixels, few, self.threads)
        if not squares:
            return
        images = GrayImages(list(squares.values()), Layout((len(squares),)))
        sensor = sensor_of_squares(pixels.sensor)
        output = output_of(images, sensor, None)
        coarse = dataclasses.replace(self, images=images, sensor=sensor, output=output)
        with hide_warnings():  # the estimate of the pixels has warned
            estimates = coarse.run()
        for (index, counts), estimate in zip(squares.items(), estimates, strict=True):
            found[index] = add_coarse(found[index], estimate, sensor, counts.trials, self.threads)

    def _run_untied(self) -> None:
        """Write the intensities of a network whose first layer has one weight per jot and frame."""
        bits = self._bits_of_untied()
        mask = self.sensor.mask
        # Memory may not hold the frames of all captures in files.
        number = max(1, _MAX_BYTES // math.prod(bits[0].packed.shape))
        for start in range(0, len(bits), number):
            part = bits[start : start + number]
            places = list(self.output.images[start : start + number])
            if mask is not None and mask.any():
                sums, model = self._masked_sums(part, mask), sensor_model(self.sensor)
                self.network.engine_network.sums(sums, model, places, self.threads)
            else:
                # Frames that are read from files become an array here.
                packed = [each.packed[:, : each.shape[1]] for each in part]
                self._run_on_bits(packed, bits[0].width, places)
        if mask is not None:
            dead = Bits.from_array(~mask).counts(self.sensor.oversampling) == 0
            warn_about_dead_pixels(np.broadcast_to(dead, (len(bits), *dead.shape)))

    def _bits_of_untied(self) -> Sequence[Bits]:
        """Return the bits of the images, after a check that an untied network serves them."""
        sensor = self.sensor
        for data in self.images.data:
            if not isinstance(data, Bits):
                raise TypeError(
                    f"data: expected Bits, because this network weighs each jot of a pixel, got "
                    f"{type(data).__name__}; a tied network takes counts"
                )
            check_fits(data.shape, sensor)
        jots = sensor.efficiency, sensor.dark_counts
        reference = Jot(
            reference_jot(sensor).efficiency, reference_jot(self.network.sensor).dark_counts
        )
        if any(np.any(a != b) for a, b in zip(jots, reference, strict=True)):
            raise ValueError(
                "sensor: expected the network's efficiency and dark counts, the same for all jots; "
                "a tied network takes others"
            )
        return cast(Sequence[Bits], self.images.data)

    def _masked_sums(self, bits: Sequence[Bits], mask: npt.NDArray[np.bool_]) -> list[Image]:
        """Return p of each image, (C, H, W), from the valid jots. Dead pixels are inpainted."""
        first, side = self.network.layers[0], self.sensor.oversampling
        height, width = (size // side for size in mask.shape)
        valid = np.packbits(~mask, axis=1)
        sums = np.empty((len(bits), len(first.filters), height, width), np.float32)
        for _, rows in frame_chunks(1, height, len(bits) * width * first.filters.size):
            jots = slice(rows.start * side, rows.stop * side)
            packed = [each.packed[:, jots] for each in bits]
            sums[:, :, rows.start : rows.stop] = self.network.engine_network.masked_sums(
                packed, bits[0].width, valid[jots], self.threads
            )
        # A pixel without a valid jot is NaN in every channel.
        planes = sums.reshape(-1, height, width)
        return list(fill_dead_pixels(planes, np.isnan(planes)).reshape(sums.shape))


def _with_typical_sensor(pixels: PixelCounts) -> PixelCounts:
    """Return pixel counts whose sensor has the median efficiency and dark counts of the pixels.

    Merged counts may have others than their sensor. Then, the counts of an equivalent sensor with
    fewer dark counts would hide how noisy they are.
    """
    typical = typical_jot(pixels.trials, pixels.efficiency, pixels.dark_counts)
    if reference_jot(pixels.sensor) == typical:
        return pixels
    efficiency, dark_counts = typical
    sensor = pixels.sensor.replace(efficiency=efficiency, dark_counts=dark_counts)
    return dataclasses.replace(pixels, sensor=sensor)
