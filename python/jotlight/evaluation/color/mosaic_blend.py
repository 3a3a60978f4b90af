"""The blend of the color network with other methods behind a mosaic, chosen by held-out bits."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from jotlight.array_types import Image
from jotlight.errors import hide_warnings
from jotlight.estimators.admm import admm_tv
from jotlight.estimators.demosaicing import demosaic
from jotlight.estimators.inpaint import NO_VALID_BIT, warn_about_dead_pixels
from jotlight.estimators.mle import mle
from jotlight.evaluation.held_out import (
    COLORS_NAME,
    NAMES,
    hold_out,
    used_weights,
    weights_of_image,
)
from jotlight.networks.color.color_inference import estimate_mosaic
from jotlight.networks.color.mosaic_planes import estimate_values
from jotlight.networks.pretrained import (
    COLOR_START,
    DEFAULT_SIZE,
    MOSAIC_FILE,
    pretrained_color,
    pretrained_conditional,
)
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.parameters.mosaic import Mosaic


def blend_mosaic(
    counted: PixelCounts, mosaic: Mosaic, demosaicing: str, threads: int | None
) -> tuple[Image, dict[str, float]]:
    """Return the blend of colors under which held-out bits are most likely, and the shares.

    The color network, and the methods of :func:`jotlight.evaluation.held_out.held_out` for planes,
    estimate the colors from four fifths of the bits of each pixel. What the colors predict behind
    the filter of a pixel is compared with its held-out bits.

    Parameters
    ----------
    counted : PixelCounts
        The counts of the pixels, (H, W). Their sensor has no mosaic.
    mosaic : Mosaic
        The filters.
    demosaicing : str
        How planes become colors: a method of :func:`jotlight.estimators.demosaicing.demosaic`.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float32, shape (H, W, 3)
        Red, green, and blue.
    dict of str to float
        The mean weight of each method, by its name. They sum to 1.
    """
    own, sensor = mosaic.without_white_balance(), counted.sensor
    methods = _methods(own, demosaicing, threads)
    ones, trials = hold_out(counted)
    rest = np.asarray(counted.trials - trials, np.float64)
    training = dataclasses.replace(counted, counts=counted.counts - ones, trials=rest)
    with hide_warnings():  # the estimates from all bits warn, too
        colors = np.stack([method(training) for method in methods.values()])
    passed = own.transmission[own.full(*counted.counts.shape)]
    lights = (colors * passed).sum(axis=-1) * sensor.light_per_intensity
    weights = used_weights(weights_of_image(counted, ones, trials, lights, threads)[:, None])[:, 0]
    total = np.zeros(colors.shape[1:], np.float32)
    for weight, method in zip(weights, methods.values(), strict=True):
        if weight.any():
            with hide_warnings(NO_VALID_BIT):
                total += weight[..., None] * method(counted)
    if counted.dead_pixels is not None:
        warn_about_dead_pixels(counted.dead_pixels[None])
    means = weights.mean(axis=(1, 2), dtype=np.float64)
    shares = {name: float(mean) for name, mean in zip(methods, means, strict=True)}
    return total * mosaic.white_balance.astype(np.float32), shares


def _methods(
    mosaic: Mosaic, demosaicing: str, threads: int | None
) -> dict[str, Callable[[PixelCounts], Image]]:
    """Return functions from the counts of a mosaic without white balance to colors (H, W, 3)."""

    def by_colors(counted: PixelCounts) -> Image:
        network = pretrained_color(MOSAIC_FILE)
        gray = pretrained_conditional(counted.sensor, COLOR_START)
        return estimate_mosaic(network, gray, counted, mosaic, threads)

    def by_network(planes: Any, sensor: Any, threads: int | None) -> Any:
        network = pretrained_conditional(sensor, DEFAULT_SIZE)
        return network.reconstruct(planes, sensor, threads=threads)

    def by_planes(run: Callable[..., Any]) -> Callable[[PixelCounts], Image]:
        def estimate(counted: PixelCounts) -> Image:
            values, weights, _ = estimate_values(
                counted, mosaic, lambda planes, own: (run(planes, own, threads=threads), None)
            )
            colors = demosaic(values, mosaic, demosaicing, weights)
            return np.clip(colors, 0, counted.sensor.max_intensity).astype(np.float32)

        return estimate

    runs: list[Callable[..., Any]] = [by_network, admm_tv, mle]
    gray = {name: by_planes(run) for name, run in zip(NAMES, runs, strict=True)}
    return {COLORS_NAME: by_colors, **gray}
