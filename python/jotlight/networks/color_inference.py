"""The colors of mosaics by a network: classical colors, improved with the bits of all filters."""

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators.demosaicing import demosaic
from jotlight.estimators.inverse_response import equivalent_counts, intensity_from_probability
from jotlight.networks.color_network import ColorNetwork
from jotlight.networks.color_planes import Filtered, color_planes
from jotlight.networks.mosaic_planes import estimate_values
from jotlight.networks.network import Network
from jotlight.sensing.maps import constant_or_map
from jotlight.sensing.mosaic import Mosaic
from jotlight.sensing.pixel_counts import PixelCounts
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.response import detection_probability
from jotlight.sensing.sensor import Sensor

Image = npt.NDArray[np.float32]


def planes_of_mosaic(
    gray: Network, counted: PixelCounts, sensor: Sensor, mosaic: Mosaic, threads: int | None
) -> Image:
    """Return what a color network reads of the image of a mosaic, (11, H, W).

    The parameters are those of :func:`estimate_mosaic`.
    """
    start = _start_colors(gray, counted, sensor, mosaic, threads)
    efficiency, dark_counts = reference_jot(sensor)

    def to_probability(intensity: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        rate = efficiency * sensor.light_per_intensity * np.maximum(intensity, 0) + dark_counts
        return detection_probability(sensor.threshold, rate)

    return color_planes(_seen_through(mosaic, counted, threads), start, to_probability)


def estimate_mosaic(
    network: ColorNetwork,
    gray: Network,
    counted: PixelCounts,
    sensor: Sensor,
    mosaic: Mosaic,
    threads: int | None,
) -> Image:
    """Return red, green, and blue of the image of a mosaic, (H, W, 3).

    Parameters
    ----------
    network : ColorNetwork
        The network.
    gray : Network
        The K-conditioned gray network for the planes, with which it was trained.
    counted : PixelCounts
        The counts of the pixels, (H, W).
    sensor : Sensor
        Their sensor, without the mosaic.
    mosaic : Mosaic
        The filters.
    threads : int, optional
        Number of threads. Default: all.
    """
    planes = planes_of_mosaic(gray, counted, sensor, mosaic, threads)
    found = network.estimate_probability(planes, _usual_trials(counted), threads=threads)
    colors = np.moveaxis(intensity_from_probability(found, sensor, threads), 0, -1)
    return colors * mosaic.white_balance.astype(np.float32)


def _start_colors(
    gray: Network, counted: PixelCounts, sensor: Sensor, mosaic: Mosaic, threads: int | None
) -> npt.NDArray[np.float64]:
    """Return red, green, and blue by a gray network and color differences, (3, H, W)."""

    def estimate(planes: Any, own: Sensor) -> tuple[Image, None]:
        return gray.reconstruct(planes, own, threads=threads), None

    values, _ = estimate_values(counted, sensor, mosaic, estimate)
    plain = dataclasses.replace(mosaic, white_balance=np.ones(3))
    return np.moveaxis(demosaic(values, plain, "differences"), -1, 0)


def _seen_through(mosaic: Mosaic, counted: PixelCounts, threads: int | None) -> list[Filtered]:
    """Return what the pixels behind each filter of a mosaic saw.

    The weight of a pixel is the number of its trials, relative to the usual one, at most 1.
    """
    some = np.where(counted.trials == 0, 1.0, counted.trials)
    alive = dataclasses.replace(counted, trials=constant_or_map(some))
    fraction = equivalent_counts(alive, reference_jot(counted.sensor), 1, threads)
    weight = np.minimum(np.asarray(counted.trials) / _usual_trials(counted), 1)
    places = mosaic.full(*fraction.shape)
    return [
        Filtered(transmission, fraction, weight * (places == index))
        for index, transmission in enumerate(mosaic.transmission)
    ]


def _usual_trials(counted: PixelCounts) -> float:
    """Return the median of the trials behind the pixels that have any; 1 if none has."""
    trials = np.broadcast_to(counted.trials, counted.counts.shape)
    known = trials[trials > 0]
    return float(np.median(known)) if len(known) else 1.0
