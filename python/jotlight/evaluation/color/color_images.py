"""The counts of images as the color networks take them, and the colors of three channels."""

import dataclasses

from jotlight.array_types import Image
from jotlight.estimators.demosaicing import COLORS
from jotlight.estimators.readings.merge_near import Merging
from jotlight.networks.color.color_inference import estimate_channels
from jotlight.networks.planes_network import ColorNetwork
from jotlight.networks.pretrained import (
    CHANNELS_FILE,
    COLOR_START,
    pretrained_color,
    pretrained_conditional,
)
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import GrayData, GrayImages, PixelCounts, count_pixels
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.sensor import Sensor


def count_image(
    one: GrayData, sensor: Sensor, threads: int | None, mosaic: Mosaic | None = None
) -> PixelCounts:
    """Return the counts of the pixels of one image, or equivalent counts of plain bits.

    Parameters
    ----------
    one : Bits, Readings, or ndarray of int
        The data of the image.
    sensor : Sensor
        The sensor of the data, without its mosaic.
    threads : int, optional
        The number of threads. Default: the number of cores.
    mosaic : Mosaic, optional
        The mosaic of the sensor.

    Examples
    --------
    >>> count_image(np.full((4, 6), 3, np.int32), jl.Sensor(frames=8), None).trials
    8
    """
    if sensor.has_plain_bits:
        counted = count_pixels(one, sensor, threads)
        if not counted.varies_within_pixels:
            return counted
    # A pixel behind a clear filter sees the sum of the colors, which may exceed S.
    most = 1.0 if mosaic is None else max(1.0, float(mosaic.sensitivity.max()))
    bright = sensor.replace(max_intensity=most * sensor.max_intensity)
    joint = joint_likelihood(one, bright, threads)
    merged = Merging(joint).near_neighbors(mosaic)
    own = merged.sensor.replace(max_intensity=sensor.max_intensity)
    return count_pixels(dataclasses.replace(merged, sensor=own), own, threads)


def reconstruct_channels(
    images: GrayImages,
    sensor: Sensor,
    out: object,
    threads: int | None,
    network: ColorNetwork | None = None,
    precision: str | None = None,
) -> Image:
    """Return red, green, and blue of images with three counts per pixel.

    Parameters
    ----------
    images : GrayImages
        The channels of all images. :func:`jotlight.evaluation.color.color_data.takes_channels`
        states which.
    sensor : Sensor
        Their sensor, with plain bits.
    out : ndarray of float32, optional
        As for :func:`jotlight.reconstruct`.
    threads : int, optional
        The number of threads. Default: the number of cores.
    network : ColorNetwork, optional
        Default: the pretrained one for channels.
    precision : {"f32", "bf16"}, optional
        Precision of the networks. Default: that of the color network.

    Examples
    --------
    >>> from jotlight.layout import Layout
    >>> images = GrayImages(np.full((3, 8, 8), 8, np.int32), Layout((3,), -1))
    >>> reconstruct_channels(images, jl.Sensor(frames=16), None, None).shape
    (8, 8, 3)
    """
    network = network or pretrained_color(CHANNELS_FILE)
    network = network if precision is None else network.with_precision(precision)
    gray = pretrained_conditional(sensor, COLOR_START).with_precision(network.precision)
    output = output_of(images, sensor, out)
    for start in range(0, len(images), COLORS):
        colors = slice(start, start + COLORS)
        channels = [count_image(one, sensor, threads) for one in images.data[colors]]
        output.images[colors] = estimate_channels(network, gray, channels, threads)
    return output.finish(output.images)
