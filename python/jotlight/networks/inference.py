"""The image of a network for bits or counts of gray images."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Protocol, cast

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import check_threads
from jotlight.chunks import frame_chunks
from jotlight.errors import hide_warnings
from jotlight.estimators.inpaint import fill_dead_pixels, warn_about_dead_pixels
from jotlight.estimators.inverse_response import (
    equivalent_counts,
    intensity_from_probability,
)
from jotlight.estimators.merge_near import merge_different_jots
from jotlight.estimators.trial_levels import LocalTrials, count_local_trials
from jotlight.layout import Layout
from jotlight.networks.dim_scenes import denoise_dim, may_be_dim
from jotlight.networks.engine_backed import sensor_model
from jotlight.networks.layer import Layer
from jotlight.sensing.bits import Bits
from jotlight.sensing.bits_checks import check_fits
from jotlight.sensing.merged import Merged
from jotlight.sensing.output_images import OutputImages
from jotlight.sensing.pixel_counts import MAX_PIXELS, GrayImages, PixelCounts
from jotlight.sensing.reference import Jot, reference_jot, typical_jot
from jotlight.sensing.sensor import Sensor
from jotlight.sensing.values import check_any_valid

_MAX_BYTES = 1 << 28
"""Maximum number of bytes of the bits in one call, if they are those of several images."""

Image = npt.NDArray[np.float32]


class GrayNetwork(Protocol):
    """A network for gray images."""

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The layers."""

    @property
    def sensor(self) -> Sensor:
        """Sensor that the network is for."""

    @property
    def trials_range(self) -> tuple[int, int] | None:
        """Smallest and largest K of a K-conditioned network."""

    @property
    def tied(self) -> bool:
        """Whether the network takes counts."""

    @property
    def engine_network(self) -> engine.Network:
        """The network in the engine."""


def run(
    network: GrayNetwork,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> Image:
    """Return the intensities in [0, S] of gray images, (N, H, W), as the images of `output`.

    The engine runs the network once for images with the same number of trials, if it serves them.
    Other images take several levels of K: those with a map of trials, and those with more trials
    than the network was trained for.

    Raises
    ------
    TypeError
        When an untied network gets counts.
    ValueError
        When the data do not fit the sensor, or an untied network gets a sensor whose jots differ
        from its own.
    """
    check_threads(threads)
    if not network.tied:
        return _run_untied(network, images, sensor, output, threads)
    if network.trials_range is None:
        return _run_tied(network, images, sensor, output, threads)
    images, sensor = merge_different_jots(images, sensor, threads)
    _run_tied(network, images, sensor, output, threads)
    _improve_dim(network, images, sensor, output, threads)
    return output.images


def _run_tied(
    network: GrayNetwork,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> Image:
    """Return the intensities of a network that takes counts."""
    model, places = sensor_model(sensor), list(output.images)
    bits = _bits_alike(images, sensor)
    if bits is not None:
        # The engine counts the bits where it needs the counts, so that it needs no array of them.
        packed = [np.asarray(each.packed) for each in bits]
        side = sensor.oversampling
        network.engine_network.bits(packed, bits[0].width, side, model, places, threads)
        return output.images
    pixels = images.count(sensor, threads)
    check_any_valid(pixels.trials)
    if network.trials_range is not None:
        pixels = _with_typical_sensor(pixels)
        model = sensor_model(pixels.sensor)
    if pixels.uniform:
        jot = cast(Jot, (pixels.efficiency, pixels.dark_counts))
        trials = cast(float, pixels.trials)
        network.engine_network.counts(pixels.counts, trials, jot, model, places, threads)
        return output.images
    return _run_different(network, pixels, output, threads)


def _improve_dim(
    network: GrayNetwork,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> None:
    """Replace the intensities of dim scenes by those of combined trials."""
    number = math.inf if isinstance(images.data[0], Merged) else sensor.trials
    dim = [index for index, each in enumerate(output.images) if may_be_dim(each, sensor, number)]
    if not dim:
        return
    part = GrayImages([images.data[index] for index in dim], Layout((len(dim),)))
    pixels = _with_typical_sensor(part.count(sensor, threads))
    with hide_warnings():  # the first estimate has warned
        fractions = equivalent_counts(pixels, reference_jot(pixels.sensor), 1, threads)
    trials = count_local_trials(pixels, threads)
    smallest, _ = cast(tuple[int, int], network.trials_range)
    found = denoise_dim(network, fractions, trials, smallest, threads=threads)
    for index, result in zip(dim, found, strict=True):
        if result is not None:
            probability, holds = np.clip(result[0], 0, 1), result[1]
            intensity = intensity_from_probability(probability, pixels.sensor, threads)
            np.copyto(output.images[index], intensity, where=holds)


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


def _run_different(
    network: GrayNetwork, pixels: PixelCounts, output: OutputImages, threads: int | None
) -> Image:
    """Return the intensities of pixels that differ in their trials or their jots."""
    sensor = pixels.sensor
    trials: list[LocalTrials] = [sensor.trials] * len(pixels.counts)
    # Both sensors detect equal light at intensity 1.
    reference = reference_jot(sensor)[0], reference_jot(network.sensor)[1]
    smallest = largest = sensor.trials
    if network.trials_range is not None:
        trials, reference = count_local_trials(pixels, threads), reference_jot(sensor)
        smallest, largest = network.trials_range
    # The network takes counts of its own K, and fractions of ones where it runs at several K.
    of = [each if isinstance(each, int) and smallest <= each <= largest else 1 for each in trials]
    values = equivalent_counts(pixels, reference, np.array(of, np.float64), threads)
    number = max(1, MAX_PIXELS // values[0].size)
    for start in range(0, len(values), number):
        part = slice(start, start + number)
        network.engine_network.equivalent_counts(
            values[part],
            of[part],
            trials[part],
            sensor_model(sensor),
            list(output.images[part]),
            threads,
        )
    return output.images


def _run_untied(
    network: GrayNetwork,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> Image:
    """Return the intensities of a network whose first layer has one weight per jot and frame."""
    bits = _bits_of_untied(network, images, sensor)
    model, mask = sensor_model(sensor), sensor.mask
    # Memory may not hold the frames of all captures in files.
    number = max(1, _MAX_BYTES // math.prod(bits[0].packed.shape))
    for start in range(0, len(bits), number):
        part = bits[start : start + number]
        places = list(output.images[start : start + number])
        if mask is not None and mask.any():
            sums = _masked_sums(network, part, mask, sensor.oversampling, threads)
            network.engine_network.sums(sums, model, places, threads)
        else:
            # Frames that are read from files become an array here.
            packed = [each.packed[:, : each.shape[1]] for each in part]
            side = sensor.oversampling
            network.engine_network.bits(packed, bits[0].width, side, model, places, threads)
    if mask is not None:
        dead = Bits.from_array(~mask).counts(sensor.oversampling) == 0
        warn_about_dead_pixels(np.broadcast_to(dead, (len(bits), *dead.shape)))
    return output.images


def _bits_of_untied(network: GrayNetwork, images: GrayImages, sensor: Sensor) -> Sequence[Bits]:
    """Return the bits of images, after a check that the network serves them."""
    for data in images.data:
        if not isinstance(data, Bits):
            raise TypeError(
                f"data: expected Bits, because this network weighs each jot of a pixel, got "
                f"{type(data).__name__}; a tied network takes counts"
            )
        check_fits(data.shape, sensor)
    jots = sensor.efficiency, sensor.dark_counts
    reference = reference_jot(sensor)[0], reference_jot(network.sensor)[1]
    if any(np.any(a != b) for a, b in zip(jots, reference, strict=True)):
        raise ValueError(
            "sensor: expected the network's efficiency and dark counts, the same for all jots; "
            "a tied network takes others"
        )
    return cast(Sequence[Bits], images.data)


def _masked_sums(
    network: GrayNetwork,
    bits: Sequence[Bits],
    mask: npt.NDArray[np.bool_],
    side: int,
    threads: int | None,
) -> list[Image]:
    """Return p of each image, (C, H, W), from the valid jots. Dead pixels are inpainted."""
    first = network.layers[0]
    height, width = (size // side for size in mask.shape)
    valid = np.packbits(~mask, axis=1)
    sums = np.empty((len(bits), len(first.filters), height, width), np.float32)
    for _, rows in frame_chunks(1, height, len(bits) * width * first.filters.size):
        jots = slice(rows.start * side, rows.stop * side)
        packed = [each.packed[:, jots] for each in bits]
        sums[:, :, rows.start : rows.stop] = network.engine_network.masked_sums(
            packed, bits[0].width, valid[jots], threads
        )
    # A pixel without a valid jot is NaN in every channel.
    planes = sums.reshape(-1, height, width)
    return list(fill_dead_pixels(planes, np.isnan(planes)).reshape(sums.shape))


def _bits_alike(images: GrayImages, sensor: Sensor) -> Sequence[Bits] | None:
    """Return bits in memory of which only the number of ones of each pixel matters.

    Return None for other data, and for sensors with maps.
    """
    for each in images.data:
        if not (isinstance(each, Bits) and isinstance(each.packed, np.ndarray)):
            return None
        check_fits(each.shape, sensor)
    bits = cast(Sequence[Bits], images.data)
    are_alike = not sensor.maps() and len({each.shape for each in bits}) == 1
    return bits if are_alike else None
