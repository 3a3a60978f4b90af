"""The image of a K-conditioned network for smooth kernels and for grids of half pixels."""

import dataclasses

import numpy as np

from jotlight.array_types import Image
from jotlight.estimators.deconvolution import deconvolve
from jotlight.networks.inference.finer_grid import (
    Prior,
    Squares,
    coarse_counts,
    enlarge,
    estimate_light,
)
from jotlight.networks.inference.inference import Inference
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import gray_images
from jotlight.sensing.merged import Merged, is_finer


def estimate_intensity(task: Inference) -> Image:
    """Return the intensities of gray images by a K-conditioned network, (N, H, W).

    With a smooth kernel, the network estimates the mean light at the jots of each pixel, and the
    intensities follow by deconvolution.
    """
    sensor = task.sensor
    if any(is_finer(each) for each in task.images.data):
        return _estimate_finer(task)
    estimate = task.run()
    if sensor.kernel == "box":
        return estimate
    return np.clip(deconvolve(estimate, sensor), 0, np.float32(sensor.max_intensity))


def _estimate_finer(task: Inference) -> Image:
    """Return the intensities of counts on a grid of half pixels, (N, H, W)."""
    network, sensor = task.network, task.sensor
    prior = Prior(network, sensor, network.estimates_zeros(sensor), task.threads)
    scale = sensor.light_per_intensity
    for place, merged in zip(task.output.images, task.images.data, strict=True):
        if not isinstance(merged, Merged) or merged.upsample == 1:
            raise ValueError("data: expected the same grid in all images, got different ones")
        images = gray_images(coarse_counts(merged))
        coarse = dataclasses.replace(task, images=images, output=output_of(images, sensor, None))
        enlarged = enlarge(estimate_intensity(coarse)[0])
        light = estimate_light(Squares.of(merged), prior, scale * enlarged)
        place[:] = np.clip(light / scale, 0, sensor.max_intensity)
    return task.output.images
