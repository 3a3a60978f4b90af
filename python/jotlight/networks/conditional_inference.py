"""The image of a K-conditioned network for smooth kernels and for grids of half pixels."""

from typing import Protocol

import numpy as np

from jotlight.estimators.deconvolution import deconvolve
from jotlight.networks import inference
from jotlight.networks.finer_grid import (
    Prior,
    Squares,
    coarse_counts,
    enlarge,
    estimate_light,
)
from jotlight.networks.inference import Image
from jotlight.sensing.gray_outputs import output_of
from jotlight.sensing.merged import Merged, is_finer
from jotlight.sensing.output_images import OutputImages
from jotlight.sensing.pixel_counts import GrayImages, gray_images
from jotlight.sensing.sensor import Sensor


class ConditionalGrayNetwork(inference.GrayNetwork, Protocol):
    """A K-conditioned network."""

    def estimates_zeros(self, sensor: Sensor) -> bool:
        """Return whether the network estimates P(b = 0) for a sensor."""


def estimate_intensity(
    network: ConditionalGrayNetwork,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> Image:
    """Return the intensities of gray images, (N, H, W).

    With a smooth kernel, the network estimates the mean light at the jots of each pixel, and the
    intensities follow by deconvolution.

    Parameters
    ----------
    network : ConditionalGrayNetwork
        A K-conditioned network.
    images : GrayImages
        The data.
    sensor : Sensor
        Sensor of the data.
    output : OutputImages
        Images for the result, which are used if they save memory.
    threads : int, optional
        Number of threads. Default: all.
    """
    if any(is_finer(each) for each in images.data):
        return _estimate_finer(network, images, sensor, output, threads)
    estimate = inference.run(network, images, sensor, output, threads)
    if sensor.kernel == "box":
        return estimate
    return np.clip(deconvolve(estimate, sensor), 0, np.float32(sensor.max_intensity))


def _estimate_finer(
    network: ConditionalGrayNetwork,
    images: GrayImages,
    sensor: Sensor,
    output: OutputImages,
    threads: int | None,
) -> Image:
    """Return the intensities of counts on a grid of half pixels, (N, H, W)."""
    prior = Prior(network, sensor, network.estimates_zeros(sensor), threads)
    scale = sensor.light_per_intensity
    for place, merged in zip(output.images, images.data, strict=True):
        if not isinstance(merged, Merged) or merged.upsample == 1:
            raise ValueError("data: expected the same grid in all images, got different ones")
        coarse = gray_images(coarse_counts(merged))
        own = output_of(coarse, sensor, None)
        enlarged = enlarge(estimate_intensity(network, coarse, sensor, own, threads)[0])
        light = estimate_light(Squares.of(merged), prior, scale * enlarged)
        place[:] = np.clip(light / scale, 0, sensor.max_intensity)
    return output.images
