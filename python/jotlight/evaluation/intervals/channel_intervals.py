"""Intervals of the colors that the color network estimates from three counts per pixel."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from jotlight.array_types import Image
from jotlight.errors import hide_warnings
from jotlight.estimators.demosaicing import COLORS
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.color.color_images import reconstruct_channels
from jotlight.evaluation.intervals.error_scale import Half, divide_bits, error_model
from jotlight.evaluation.intervals.interval_pixels import Pixels
from jotlight.evaluation.intervals.intervals import MIN_TRIALS
from jotlight.layout import Layout
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.sensor import Sensor

_SHARE = 0.85
"""Scale of the errors of the color network, relative to that of the network "medium" for each
channel."""


def find_channel_intervals(
    images: GrayImages,
    estimates: Image,
    sensor: Sensor,
    *,
    confidence_level: float,
    threads: int | None,
) -> Uncertainty:
    """Return the uncertainty of estimates of the color network, in units of intensity.

    The errors of the network "medium" are known from photographs. Those of the color network are
    smaller, because it reads all channels together. Its own estimates from half of the bits correct
    them.

    Parameters
    ----------
    images : GrayImages
        The channels of all images, which
        :func:`jotlight.evaluation.color.color_data.takes_channels` accepts.
    estimates : ndarray of float32, shape (N, H, W)
        The estimates of the color network.
    sensor : Sensor
        The sensor of the data.
    confidence_level : float
        Coverage of the intervals.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    gray = error_model()
    factor = np.array([np.log(_SHARE), *np.zeros(len(gray.weights) - 1)])
    model = dataclasses.replace(gray, weights=gray.weights + factor)
    results: list[Uncertainty] = []
    for start in range(0, len(images), COLORS):
        part = GrayImages(images.data[start : start + COLORS], Layout((COLORS,), -1))
        counted = part.count(sensor, threads)
        each = [Pixels.of(counted, index, threads) for index in range(COLORS)]
        halves = [divide_bits(one.ones, one.trials) for one in each]
        of_halves = _estimate_halves(each, halves, threads)
        for index, (one, own) in enumerate(zip(each, halves, strict=True)):
            known = estimates[start + index]
            errors = one.errors(own, [colors[index] for colors in of_halves])
            of_network = one.known_errors(known, errors, model)
            results.append(one.uncertainty(known, of_network, confidence_level))
    return Uncertainty.arrange(results, images.layout)


def _estimate_halves(
    pixels: Sequence[Pixels], halves: Sequence[Sequence[Half]], threads: int | None
) -> list[Image]:
    """Return the colors from each half of the bits, (3, H, W), or none if they show no errors."""
    if min(np.median(one.trials) for one in pixels) < MIN_TRIALS:
        return []
    found = []
    for half in zip(*halves, strict=True):
        data = [one.merged(own.ones, own.trials) for one, own in zip(pixels, half, strict=True)]
        with hide_warnings():
            colors = reconstruct_channels(
                GrayImages(data, Layout((COLORS,), -1)), pixels[0].sensor, None, threads
            )
        found.append(np.ascontiguousarray(np.moveaxis(colors, -1, 0)))
    return found
