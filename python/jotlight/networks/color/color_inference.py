"""Colors by a network: classical colors, improved with the bits of all filters or channels."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from jotlight.array_types import Array, Image
from jotlight.blur import blur
from jotlight.estimators.inverse_response import equivalent_fractions, intensity_from_probability
from jotlight.estimators.trial_levels import (
    LocalTrials,
    fill_from_nearest,
    local_trials,
    share_levels,
)
from jotlight.networks.color.color_starts import start_of_channels, start_of_mosaic
from jotlight.networks.color.fringes import remove_fringes
from jotlight.networks.network import Network
from jotlight.networks.planes.color_planes import DEVIATIONS, START, Filtered, color_planes
from jotlight.networks.planes.planes_layers import CENTER
from jotlight.networks.planes_network import ColorNetwork
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.likelihood.reference import reference_jot, response_of
from jotlight.sensing.merged import MAX_SILENT_TRIALS
from jotlight.sensing.parameters.binomial import arcsin_root, squared_sine
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.sensor import Sensor

MIN_LARGEST = 4.0
"""The classical colors may reach this intensity, or S if it is larger. If they were clipped at 1,
they would contradict the bits of overexposed pixels, whose colors would then be wrong."""

_SATURATED = 6.0, 12.0
"""Detections per jot and frame behind the clearest filter up to which the network's colors are used
alone, and from which the classical ones are. All bits of these pixels are 1, which the network
takes for agreement with its start, and its own colors are too bright."""

_TRUST_SIGMA = 2.0
"""Standard deviation of the filter of this light, in pixels."""

_TRIALS_SIGMA = 3.0
"""Standard deviation of the filter of the local trials, in pixels."""


_Planes = Callable[[float], Image]
"""A function of a number of trials, which returns what a network for them reads, (11, H, W)."""


def planes_of_mosaic(
    gray: Network, counted: PixelCounts, mosaic: Mosaic, threads: int | None
) -> Image:
    """Return what a color network reads of the image of a mosaic, (11, H, W).

    The parameters are those of :func:`estimate_mosaic`. The network is one for the largest number
    of trials.
    """
    return _read_mosaic(gray, counted, mosaic, threads)[1](float(np.max(counted.trials)))


def _read_mosaic(
    gray: Network, counted: PixelCounts, mosaic: Mosaic, threads: int | None
) -> tuple[Array, _Planes]:
    """Return the classical colors of a mosaic, (3, H, W), and the planes."""
    brighter = dataclasses.replace(counted, sensor=_with_range(counted.sensor))
    start = start_of_mosaic(gray, brighter, mosaic, threads)
    response = response_of(brighter.sensor)
    places = mosaic.full(*counted.counts.shape)
    fraction = equivalent_fractions(counted, threads, places)

    def planes(trials: float) -> Image:
        weight = _weights(counted, trials)
        seen = [
            Filtered(transmission, fraction, weight * (places == index))
            for index, transmission in enumerate(mosaic.transmission)
        ]
        return color_planes(seen, start, response)

    return start, planes


def planes_of_channels(
    gray: Network, channels: Sequence[PixelCounts], threads: int | None
) -> Image:
    """Return what a color network reads of an image with three counts per pixel, (11, H, W).

    The parameters are those of :func:`estimate_channels`. The network is one for the largest number
    of trials.
    """
    most = max(float(np.max(counted.trials)) for counted in channels)
    return _read_channels(gray, channels, threads)(most)


def _read_channels(gray: Network, channels: Sequence[PixelCounts], threads: int | None) -> _Planes:
    """Return the planes of an image with three counts per pixel."""
    fractions = [equivalent_fractions(counted, threads) for counted in channels]

    def filtered(trials: float) -> list[Filtered]:
        parts = zip(np.eye(3), fractions, channels, strict=True)
        return [Filtered(share, part, _weights(each, trials)) for share, part, each in parts]

    sensor = channels[0].sensor
    response, brighter = response_of(sensor), _with_range(sensor)
    start = start_of_channels(gray, channels, filtered(1.0), brighter, response, threads)
    return lambda trials: color_planes(filtered(trials), start, response)


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
        The number of threads. Default: the number of cores.
    """
    sensor = counted.sensor
    start, planes = _read_mosaic(gray, counted, mosaic, threads)
    found = _run(network, planes, _local_trials([counted], threads), threads)
    colors = intensity_from_probability(found, sensor, threads)
    colors = np.clip(remove_fringes(colors, mosaic, threads), 0, sensor.max_intensity)
    trust = _trust(start, sensor, mosaic)
    if (trust < 1).any():
        colors += (1 - trust) * (np.clip(start, 0, sensor.max_intensity) - colors)
    return np.moveaxis(colors, 0, -1) * mosaic.white_balance.astype(np.float32)


def _trust(start: Array, sensor: Sensor, mosaic: Mosaic) -> Image:
    """Return how much of the network's change of the classical colors is used, 0 to 1, (H, W).

    It falls from 1 to 0 where the clearest filter passes more light than in the training.
    """
    from scipy.ndimage import gaussian_filter

    light = sensor.light_per_intensity * reference_jot(sensor).efficiency
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
        The number of threads. Default: the number of cores.
    """
    planes = _read_channels(gray, channels, threads)
    found = _run(network, planes, _local_trials(channels, threads), threads)
    return intensity_from_probability(found, channels[0].sensor, threads)


def _with_range(sensor: Sensor) -> Sensor:
    """Return a sensor whose classical colors reach the intensities of the training."""
    return sensor.replace(max_intensity=max(sensor.max_intensity, MIN_LARGEST))


def _run(network: ColorNetwork, planes: _Planes, trials: LocalTrials, threads: int | None) -> Image:
    """Return P(b = 1) of each color, (3, H, W).

    A network is for one number of trials, so it runs at some levels of their map.
    """
    if isinstance(trials, int):
        return _improve(network, planes(trials), trials, threads)
    found = np.zeros((3, *trials.shape), np.float32)
    for level, [(_, weights)] in share_levels([trials]):
        part = _improve(network, planes(level), level, threads)
        found += part if weights is None else weights * part
    return found


def _improve(network: ColorNetwork, planes: Image, trials: int, threads: int | None) -> Image:
    """Return P(b = 1) of each color, (3, H, W), by a network for one number of trials.

    Above its range, the deviations of the bits from the classical colors are amplified until their
    noise is that of its largest number of trials. They change these colors by that much less.
    """
    gain = np.sqrt(np.float32(max(1, trials / network.trials_range[1])))
    if gain == 1:
        return network.estimate_probability(planes, trials, threads=threads)
    start = planes[START] + np.float32(CENTER)
    planes[DEVIATIONS] *= gain
    found = arcsin_root(network.estimate_probability(planes, trials, threads=threads))
    return squared_sine(start + (found - start) / gain)


def _weights(counted: PixelCounts, trials: float) -> Array:
    """Return the trials of each pixel, relative to those of the network, at most 1, (H, W)."""
    weights = np.minimum(np.asarray(counted.trials) / trials, 1)
    return np.broadcast_to(weights, counted.counts.shape)


def _local_trials(channels: Sequence[PixelCounts], threads: int | None) -> LocalTrials:
    """Return the local trials of counts of the same pixels: a number from 1, or a map (H, W).

    They are means over nearby pixels and over the channels. A harmonic mean, as for gray images,
    would be that of the filters that say least, and hide what the others say. Pixels that say
    nothing have the trials of the nearest other.
    """
    maps: list[Array] = []
    for counted in channels:
        trials = np.broadcast_to(counted.trials, counted.counts.shape).astype(np.float64)
        known = trials > MAX_SILENT_TRIALS
        if known.any():
            filled = fill_from_nearest(trials, known)
            maps.append(np.asarray(np.maximum(filled, 1), np.float64))
    if not maps:
        return 1
    return local_trials(blur(np.mean(maps, axis=0), _TRIALS_SIGMA, threads), threads)
