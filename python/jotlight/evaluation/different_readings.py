"""Readings that a count of ones does not describe, for methods that take counts."""

import dataclasses
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from jotlight.estimators.merge_readings import merge_images, reference_sensor, round_ones
from jotlight.evaluation.methods import LARGE_METHOD, find_method
from jotlight.networks.color_network import AnyNetwork
from jotlight.networks.network import Network
from jotlight.sensing.merged import Merged
from jotlight.sensing.pixel_counts import GrayImages
from jotlight.sensing.readings import require_plain_bits
from jotlight.sensing.sensor import Sensor

_SIGMA = 0.5
"""Standard deviation of the average over neighbors, in pixels, for maps of thresholds."""


def with_one_response(
    images: GrayImages,
    sensor: Sensor,
    method: str | AnyNetwork | Callable[..., Any] | None,
    threads: int | None,
) -> tuple[GrayImages, Sensor]:
    """Return equivalent counts for a method, and their sensor, which has plain bits.

    Parameters
    ----------
    images : GrayImages
        The data of a sensor whose readings differ.
    sensor : Sensor
        That sensor.
    method : str, Network, or callable, optional
        The method. Default: the recommended one.
    threads : int, optional
        The number of threads. Default: all cores.

    Raises
    ------
    ValueError
        When the method is a network for one number of trials, because equivalent counts have
        different ones.

    Examples
    --------
    >>> from jotlight.sensing.pixel_counts import gray_images
    >>> import numpy as np
    >>> sensor = Sensor(frames=2, gain=[1.0, 8.0])
    >>> bits = sensor.expose(np.full((2, 2), 0.5), rng=0)
    >>> with_one_response(gray_images(bits), sensor, None, None)[1]
    Sensor(frames=2)
    """
    if isinstance(method, Network) and method.trials_range is None:
        require_plain_bits(sensor)
    merged = merge_images(images, sensor, threads)
    if np.ndim(sensor.threshold) == 2 and _is_network(method):
        each = [_average_neighbors(cast(Merged, one)) for one in merged.data]
        merged = GrayImages(each, merged.layout)
    return merged, reference_sensor(sensor)


def _is_network(method: object) -> bool:
    """Return whether a method is a network or the name of one, or the recommended method."""
    if isinstance(method, str) and method != LARGE_METHOD:
        return find_method(method).quality is not None
    return method is None or isinstance(method, Network)


def _average_neighbors(merged: Merged) -> Merged:
    """Return counts whose trials differ little between neighbors, by a narrow Gaussian average.

    With a map of thresholds, some pixels say much and their neighbors little, such as a saturated
    pixel with two trials. Networks take their fractions for equally good.

    Examples
    --------
    >>> merged = Merged([[2, 30]], [[2.0, 60.0]], Sensor(frames=60))
    >>> averaged = _average_neighbors(merged)
    >>> (averaged.ones / averaged.trials).round(2)
    array([[0.61, 0.5 ]])
    """
    from scipy.ndimage import gaussian_filter

    trials = gaussian_filter(np.broadcast_to(np.asarray(merged.trials), merged.shape), _SIGMA)
    ones = np.minimum(gaussian_filter(merged.ones.astype(np.float64), _SIGMA), trials)
    whole, scaled = round_ones(ones, trials)
    return dataclasses.replace(merged, ones=whole, trials=scaled)


def takes_readings(method: str | None, sensor: Sensor) -> bool:
    """Return whether a method takes the readings of a sensor as they are.

    Examples
    --------
    >>> several = Sensor(frames=2, bit_depth=4)
    >>> takes_readings("noniterative-tv", several), takes_readings("admm-tv", several)
    (True, False)
    """
    if sensor.has_plain_bits or method == "mle":
        return True
    is_noniterative = method is not None and method.startswith("noniterative-")
    return is_noniterative and not sensor.readings_differ
