"""The classical colors that a color network improves."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Colors, Image
from jotlight.estimators.demosaicing import demosaic
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.estimators.merge_readings import round_ones
from jotlight.networks.color.mosaic_planes import estimate_values
from jotlight.networks.network import Network
from jotlight.networks.planes.color_planes import Filtered
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.sensor import Sensor

_SIDE, _EXPONENT = 30.0, -0.35
"""Side of the squares over which colors follow the common image, in pixels, at a signal-to-noise
ratio of 1 per pixel and channel, and how it falls with the square of this ratio."""

_SIDES = 5, 61
"""The smallest and the largest side."""

_NOISE = 0.1
"""Variance of the common image, relative to that of a fraction of ones, below which colors no
longer follow it."""

_MIN_WEIGHT = 1e-9
"""Share of known pixels below which a square has none. Running means have rounding errors."""


def start_of_mosaic(
    gray: Network, counted: PixelCounts, mosaic: Mosaic, threads: int | None
) -> Colors:
    """Return colors of a mosaic by a gray network and color differences, (3, H, W).

    The parameters are those of :func:`jotlight.networks.color.color_inference.estimate_mosaic`.
    """

    def estimate(planes: Any, own: Sensor) -> tuple[Image, None]:
        return gray.reconstruct(planes, own, threads=threads), None

    values, weights, _ = estimate_values(counted, mosaic, estimate)
    colors = demosaic(values, mosaic.without_white_balance(), "differences", weights)
    return np.moveaxis(colors, -1, 0)


def start_of_channels(
    gray: Network,
    channels: Sequence[PixelCounts],
    seen: Sequence[Filtered],
    sensor: Sensor,
    to_probability: Callable[[Colors], Colors],
    threads: int | None,
) -> Colors:
    """Return colors of channels by a gray network and local regression, (3, H, W).

    The gray network estimates the mean of P(b = 1) over the channels from all their bits together,
    because most structure is common to all. In squares around each pixel, which are as large as the
    noise requires, the fractions of ones of each channel are a linear function of this common
    image, by least squares: a guided filter.

    Parameters
    ----------
    gray : Network
        The K-conditioned gray network.
    channels : sequence of PixelCounts
        The counts of red, green, and blue.
    seen : sequence of Filtered
        The same as fractions of ones, with the weights of their pixels.
    sensor : Sensor
        Their sensor.
    to_probability : callable
        The response of the sensor: P(b = 1) of an intensity.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Notes
    -----
    K. He, J. Sun, X. Tang, "Guided image filtering", IEEE TPAMI 35(6), 2013, equations (5) to (8).
    """
    together = _together(channels, sensor)
    mean = gray.reconstruct(together, sensor, threads=threads)
    common = to_probability(mean.astype(np.float64))
    trials = float(np.mean(together.trials)) / len(channels)
    usual = float(np.clip(common.mean(), 1e-6, 1 - 1e-6))
    side = _side(trials * usual / (1 - usual))
    noise = _NOISE * usual * (1 - usual) / trials
    deviations = np.stack(
        [
            guided_filter(common, each.fraction - common, each.weight > 0, side, noise)
            for each in seen
        ]
    )
    # Their mean is 0, because the common image is the mean of the channels.
    found = common + deviations - deviations.mean(axis=0)
    probability = np.clip(found, 0, 1).astype(np.float32)
    return intensity_from_probability(probability, sensor, threads).astype(np.float64)


def _together(channels: Sequence[PixelCounts], sensor: Sensor) -> Merged:
    """Return the bits of all channels as those of one gray image, the mean of the channels.

    Where the channels have different numbers of trials, their mean has the variance of fewer
    trials than the sum. It is unknown where a channel has none.
    """
    first = channels[0]
    counts = np.stack([each.counts for each in channels])
    each = np.stack([np.broadcast_to(one.trials, first.counts.shape) for one in channels])
    each = each.astype(np.float64)
    ones, trials = counts.sum(axis=0, dtype=np.int32), each.sum(axis=0)
    if (each != each[0]).any():
        known = (each > 0).all(axis=0)
        some = np.where(known, each, 1.0)
        trials = known * len(channels) ** 2 / (1 / some).sum(axis=0)
        ones, trials = round_ones(trials * (counts / some).mean(axis=0), trials)
    return Merged(ones, trials, sensor, dark_counts=first.dark_counts, efficiency=first.efficiency)


def _side(ratio: float) -> int:
    """Return the odd side of a square for the square of a signal-to-noise ratio."""
    side = float(np.clip(_SIDE * ratio**_EXPONENT, *_SIDES))
    return 2 * round((side - 1) / 2) + 1


def guided_filter(
    guide: Colors,
    values: Colors,
    known: npt.NDArray[np.bool_],
    side: int,
    noise: float,
) -> Colors:
    """Return values as a linear function of a guide in the square around each pixel.

    Parameters
    ----------
    guide, values : ndarray of float64, shape (H, W)
        The guide, and the values that follow it.
    known : ndarray of bool, shape (H, W)
        Where the values are known.
    side : int
        The odd side of the squares, in pixels.
    noise : float
        The variance of the guide in a square at which the slope is half of the best one.

    Returns
    -------
    ndarray of float64, shape (H, W)
        0 where no value is known in the squares around a pixel.

    Examples
    --------
    >>> guide = np.linspace(0, 1, 36).reshape(6, 6)
    >>> found = guided_filter(guide, 3 - 2 * guide, np.ones((6, 6), bool), side=3, noise=1e-9)
    >>> bool(np.abs(found - (3 - 2 * guide)).max() < 1e-5)
    True
    """
    from scipy.ndimage import uniform_filter

    def mean(array: Colors) -> Colors:
        return np.asarray(uniform_filter(array, side, mode="constant"))

    weight = known.astype(np.float64)
    number = mean(weight)
    inverse = np.divide(1, number, out=np.zeros_like(number), where=number > _MIN_WEIGHT)
    average, level = inverse * mean(weight * guide), inverse * mean(weight * values)
    variance = inverse * mean(weight * guide**2) - average**2
    covariance = inverse * mean(weight * guide * values) - average * level
    slope = covariance / (np.maximum(variance, 0) + noise)
    # The mean of all squares that contain a pixel and some known values.
    has = (inverse > 0).astype(np.float64)
    squares = np.maximum(mean(has), _MIN_WEIGHT)
    offset = has * (level - slope * average)
    found: Colors = (mean(has * slope) * guide + mean(offset)) / squares
    return found
