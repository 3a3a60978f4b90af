"""Intervals of the intensity around the estimate of any method."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from jotlight.array_types import Image
from jotlight.errors import hide_warnings
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.intervals.error_scale import Half, divide_bits, error_model
from jotlight.evaluation.intervals.interval_pixels import Pixels
from jotlight.layout import Layout
from jotlight.networks.network import Network
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.sensor import Sensor

MIN_TRIALS = 4
"""Minimum number of trials whose halves show errors; see `MIN_HELD_OUT`."""


def find_intervals(
    images: GrayImages,
    estimates: Image,
    sensor: Sensor,
    network: Network,
    *,
    is_own: bool,
    confidence_level: float,
    threads: int | None,
) -> Uncertainty:
    """Return the uncertainty of the estimates of images, in units of intensity.

    Parameters
    ----------
    images : GrayImages
        The data of N images.
    estimates : ndarray of float32, shape (N, H, W)
        Estimates of any method.
    sensor : Sensor
        The sensor of the data.
    network : Network
        A K-conditioned network that serves the sensor.
    is_own : bool
        Whether the estimates are those of this network.
    confidence_level : float
        Coverage of the intervals.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    results: list[Uncertainty] = []
    for part in images.parts(sensor):
        pixels = part.count(sensor, threads)
        each = [Pixels.of(pixels, index, threads) for index in range(len(part))]
        halves = [divide_bits(one.ones, one.trials) for one in each]
        of_halves = estimate_halves(network, each, halves, threads)
        own = estimates[len(results) : len(results) + len(part)]
        known = own if is_own else _quietly(network, part, sensor, threads)
        for place, one in enumerate(each):
            errors = one.errors(halves[place], of_halves[place])
            of_network = one.known_errors(known[place], errors, error_model())
            if not is_own:
                difference = one.stabilize(own[place]) - one.stabilize(known[place])
                of_network = of_network.widened(difference)
            results.append(one.uncertainty(own[place], of_network, confidence_level))
    return Uncertainty.arrange(results, images.layout)


def estimate_halves(
    network: Network,
    pixels: Sequence[Pixels],
    halves: Sequence[Sequence[Half]],
    threads: int | None,
) -> list[Sequence[Image]]:
    """Return the estimates from each half of the bits of images, or none if they show no errors."""
    places = [i for i, one in enumerate(pixels) if np.median(one.trials) >= MIN_TRIALS]
    results: list[Sequence[Image]] = [[] for _ in pixels]
    if places:
        data = [
            pixels[place].merged(half.ones, half.trials)
            for place in places
            for half in halves[place]
        ]
        images = GrayImages(data, Layout((len(data),)))
        estimates = _quietly(network, images, pixels[0].sensor, threads)
        for index, place in enumerate(places):
            results[place] = list(estimates[2 * index : 2 * index + 2])
    return results


def _quietly(network: Network, images: GrayImages, sensor: Sensor, threads: int | None) -> Image:
    """Return the estimates (N, H, W) of a network without warnings, which the method issues."""
    images = dataclasses.replace(images, layout=Layout((len(images),)))
    with hide_warnings():
        return network.reconstruct(images, sensor, threads=threads)
