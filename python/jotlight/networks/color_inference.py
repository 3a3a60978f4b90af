"""Colors by a network: classical colors, improved with the bits of all filters or channels."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.estimators.inverse_response import equivalent_fractions, intensity_from_probability
from jotlight.networks.color_network import ColorNetwork
from jotlight.networks.color_planes import Filtered, color_planes
from jotlight.networks.color_starts import start_of_channels, start_of_mosaic
from jotlight.networks.network import Network
from jotlight.sensing.merged import MAX_SILENT_TRIALS
from jotlight.sensing.mosaic import Mosaic
from jotlight.sensing.pixel_counts import PixelCounts
from jotlight.sensing.reference import reference_jot, response_of
from jotlight.sensing.sensor import Sensor

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]

MIN_LARGEST = 4.0
"""The classical colors may reach this intensity, or S if it is larger. If they were clipped at 1,
they would contradict the bits of overexposed pixels, whose colors would then be wrong."""

_SATURATED = 6.0, 12.0
"""Detections per jot and frame behind the clearest filter up to which the network's colors are used
alone, and from which the classical ones are. All bits of these pixels are 1, which the network
takes for agreement with its start, and its own colors are too bright."""

_TRUST_SIGMA = 2.0
"""Standard deviation of the filter of this light, in pixels."""


def planes_of_mosaic(
    gray: Network, counted: PixelCounts, mosaic: Mosaic, threads: int | None
) -> Image:
    """Return what a color network reads of the image of a mosaic, (11, H, W).

    The parameters are those of :func:`estimate_mosaic`.
    """
    return _read_mosaic(gray, counted, mosaic, threads)[1]


def _read_mosaic(
    gray: Network, counted: PixelCounts, mosaic: Mosaic, threads: int | None
) -> tuple[Array, Image]:
    """Return the classical colors of a mosaic, (3, H, W), and the planes."""
    seen = _seen_through(mosaic, counted, threads)
    brighter = dataclasses.replace(counted, sensor=_with_range(counted.sensor))
    start = start_of_mosaic(gray, brighter, mosaic, threads)
    return start, color_planes(seen, start, response_of(brighter.sensor))


def planes_of_channels(
    gray: Network, channels: Sequence[PixelCounts], threads: int | None
) -> Image:
    """Return what a color network reads of an image with three counts per pixel, (11, H, W).

    The parameters are those of :func:`estimate_channels`.
    """
    seen = [
        Filtered(share, equivalent_fractions(counted, threads), _weights(counted))
        for share, counted in zip(np.eye(3), channels, strict=True)
    ]
    sensor = channels[0].sensor
    response, sensor = response_of(sensor), _with_range(sensor)
    start = start_of_channels(gray, channels, seen, sensor, response, threads)
    return color_planes(seen, start, response)


def estimate_mosaic(
    network: ColorNetwork,
    gray: Network,
    counted: PixelCounts,
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
        The counts of the pixels, (H, W). Their sensor has no mosaic.
    mosaic : Mosaic
        The filters.
    threads : int, optional
        Number of threads. Default: all.
    """
    sensor = counted.sensor
    start, planes = _read_mosaic(gray, counted, mosaic, threads)
    found = network.estimate_probability(planes, _usual_trials(counted), threads=threads)
    colors = intensity_from_probability(found, sensor, threads)
    trust = _trust(start, sensor, mosaic)
    if (trust < 1).any():
        colors += (1 - trust) * (np.clip(start, 0, sensor.max_intensity) - colors)
    return np.moveaxis(colors, 0, -1) * mosaic.white_balance.astype(np.float32)


def _trust(start: Array, sensor: Sensor, mosaic: Mosaic) -> Image:
    """Return how much of the network's change of the classical colors is used, 0 to 1, (H, W).

    It falls from 1 to 0 where the clearest filter passes more light than in the training.
    """
    from scipy.ndimage import gaussian_filter

    light = sensor.light_per_intensity * reference_jot(sensor)[0]
    rates = light * np.tensordot(mosaic.transmission, start, 1).max(axis=0)
    low, high = _SATURATED
    smooth = gaussian_filter(rates, _TRUST_SIGMA)
    return np.asarray(np.clip((high - smooth) / (high - low), 0, 1), np.float32)


def estimate_channels(
    network: ColorNetwork,
    gray: Network,
    channels: Sequence[PixelCounts],
    threads: int | None,
) -> Image:
    """Return red, green, and blue of an image with three counts per pixel, (3, H, W).

    Parameters
    ----------
    network : ColorNetwork
        The network.
    gray : Network
        The K-conditioned gray network with which it was trained.
    channels : sequence of PixelCounts
        The counts of red, green, and blue, (H, W) each, of the same sensor.
    threads : int, optional
        Number of threads. Default: all.
    """
    planes = planes_of_channels(gray, channels, threads)
    trials = float(np.median([_usual_trials(counted) for counted in channels]))
    found = network.estimate_probability(planes, trials, threads=threads)
    return intensity_from_probability(found, channels[0].sensor, threads)


def _with_range(sensor: Sensor) -> Sensor:
    """Return a sensor whose classical colors reach the intensities of the training."""
    return sensor.replace(max_intensity=max(sensor.max_intensity, MIN_LARGEST))


def _seen_through(mosaic: Mosaic, counted: PixelCounts, threads: int | None) -> list[Filtered]:
    """Return what the pixels behind each filter of a mosaic saw."""
    places, weight = mosaic.full(*counted.counts.shape), _weights(counted)
    fraction = equivalent_fractions(counted, threads, places)
    return [
        Filtered(transmission, fraction, weight * (places == index))
        for index, transmission in enumerate(mosaic.transmission)
    ]


def _weights(counted: PixelCounts) -> Array:
    """Return the number of trials of each pixel, relative to the usual one, at most 1, (H, W)."""
    weights = np.minimum(np.asarray(counted.trials) / _usual_trials(counted), 1)
    return np.broadcast_to(weights, counted.counts.shape)


def _usual_trials(counted: PixelCounts) -> float:
    """Return the median of the trials behind the pixels that say something; 1 if none does."""
    trials = np.broadcast_to(counted.trials, counted.counts.shape)
    known = trials[trials > MAX_SILENT_TRIALS]
    return float(np.median(known)) if len(known) else 1.0
